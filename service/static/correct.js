// Step 5, Correct: how the correction reaches the robot, with the error that each way leaves; programs, formats, certificate.

import { ask, keepFile, reckoned, save, upload } from "./connection.js";
import { looksOn, order } from "./desk.js";
import { nothingYet } from "./diagnose.js";
import { button, card, fact, fill, fold, footBar, h, head, icon, noteBox, numeric, table } from "./dom.js";
import { findRun, road, walk } from "./road.js";
import { number } from "./units.js";
import { t } from "./words.js";

const KINDS = { urdf: "urdf", "ur-yaml": "yaml", "dh-csv": "csv", "dh-md": "md", mastering: "csv", "abb-frames": "mod", "fanuc-frames": "ls", "kuka-frames": "dat", "ur-frames": "script", "yaskawa-frames": "txt", "abb-offsets": "txt", "fanuc-offsets": "txt", "kuka-offsets": "txt", "ur-offsets": "txt", "yaskawa-offsets": "txt", "ur-calibration": "conf" }, MOST = 100;
const ENDINGS = ".mod,.modx,.sys,.prg,.ls,.script,.urscript,.src,.dat,.dtx,.csv";
const bytesOf = (base64) => Uint8Array.from(atob(base64), (each) => each.charCodeAt(0));
const labelled = (words, input) => h("label", { className: "field" }, h("span", {}, words), input);

export function open(root, id) {
  if (!id) return nothingYet(root, 5);
  const foot = footBar(t("next")), choices = h("div", { className: "choices", role: "radiogroup", ariaLabel: t("ways") }), side = h("div", { className: "stack" }), body = h("div", { className: "cols c5-7" }, card(t("ways"), choices), side);
  root.append(head(t("stepOf", { n: 5 }), h("h1", { id: "title" }, t("correctTitle")), h("p", { className: "lead" }, t("correctLead"))), body, foot);
  let job = null, way = "program", left = {}, listed = {}, all = null, failed = null, kinds = Object.keys(KINDS).filter((each) => !/-(frames|offsets|calibration)$/.test(each)), done = null, kept = false, sent = false;
  const notes = {};

  const file = h("input", { type: "file", id: "program", accept: ENDINGS, on: { change: () => { done = null; correct(); } } }), told = h("div", { role: "status", id: "corrected", className: "stack" });
  const [tool, frame, conditions] = ["tool", "frame", "conditions"].map((name) => h("input", { id: name, maxLength: 1000, autocomplete: "off", placeholder: { tool: "0,0,100,0,0,0", frame: "0,0,0,0,0,0", conditions: "side=below" }[name] }));
  const inverse = h("input", { type: "checkbox", id: "inverse" });
  const drop = h("label", { className: "drop", on: {
    dragover: (event) => { event.preventDefault(); drop.classList.add("over"); }, dragleave: () => drop.classList.remove("over"),
    drop: (event) => { event.preventDefault(); drop.classList.remove("over"); file.files = event.dataTransfer.files; done = null; correct(); },
  } }, icon("file"), h("strong", {}, t("dropProgram")), h("span", { className: "sub" }, ENDINGS.replaceAll(",", "  ")), file);
  const program = card(t("programs"), drop, h("p", { className: "sub" }, t("programsHint")), fold(t("programMore"), "", labelled(t("programTool"), tool), labelled(t("programFrame"), frame), labelled(t("programConditions"), conditions), h("label", { className: "check" }, inverse, t("programInverse"))), told);

  // Corrects the chosen program; where targets are refused nothing is written until they are to be left as they are.
  const correct = (keep = false) => order(async () => {
    const chosen = file.files[0];
    if (!chosen) { file.click(); return; }
    const given = { program: chosen, conditions: conditions.value.trim(), inverse: inverse.checked, keep_refused: keep };
    for (const each of [tool, frame]) if (each.value.trim()) given[each.id] = each.value.trim();
    kept = keep; sent = false;
    try { done = await upload(`/models/${id}/programs`, given); }
    catch (error) {
      done = error.told && error.told.targets ? { refusedOnly: true, targets: error.told.targets } : null;
      if (!done) { told.replaceChildren(); show(); throw error; }
    }
    told.replaceChildren(...words(chosen.name));
    show();
  });
  function words(name) {
    if (done.refusedOnly) return [noteBox("ask", "alert", t("someRefused", { n: done.targets.length, name: done.targets[0].target }), h("p", {}, t("someRefusedHint"))), refusals(done.targets)];
    const refused = done.targets.filter((each) => each.status === "refused").map((each) => ({ ...each, reason: each.reason || "" }));
    return [h("h3", {}, name), h("dl", { className: "facts big3" }, fact(t("correctedShort"), `${done.corrected} / ${done.corrected + done.refused}`, t("targets")), fact(t("largestShift"), `${number(done.largest_move_mm)} mm`)), h("p", {}, t("corrected", { n: done.corrected, all: done.corrected + done.refused, mm: number(done.largest_move_mm) })),
      ...(refused.length ? [refusals(refused)] : []), ...(done.warnings.length ? [h("ul", { className: "plain" }, done.warnings.map((each) => h("li", {}, each)))] : [])];
  }
  const download = () => {
    const name = file.files[0].name;
    keepFile(new Blob([bytesOf(done.program_base64)]), `corrected-${name}`);
    sent = true; road.used = name; show();
  };
  const write = () => order(async () => {
    const made = await reckoned(`/models/${id}/exports/${way}`);
    notes[way] = [...made.about, ...made.warnings];
    keepFile(new Blob([made.text], { type: "text/plain" }), `${id}.${KINDS[way]}`);
    road.used = t(`export_${way.replace("-", "_")}`); show();
  });

  // How the error that remains is known: never from the readings of the fit.
  const leftFrom = () => (typeof all.held_out_rms_mm === "number" ? t("leftHeldOut", { mm: number(all.held_out_rms_mm) }) : typeof all.verified_rms_mm === "number" ? t("leftVerified", { mm: number(all.verified_rms_mm) }) : t("leftUnknown"));

  function aside() {
    if (way === "program") return [program];
    const of = listed[way], lines = () => notes[way] || [t("holdsFor", { conditions: all.holds_for }), of.left_out.length ? t("leavesOut", { names: of.left_out.join(", ") }) : t("leavesNothing"), t("fileLoss", { mm: number(of.loss_mm.rms), most: number(of.loss_mm.max), where: all.judged_at }), leftFrom()];
    return [card(t(`export_${way.replace("-", "_")}`), failed ? noteBox("ask", "alert", failed.message, h("p", {}, failed.whatToDo)) : of ? [h("p", {}, of.carries), h("ul", { className: "plain" }, lines().map((each) => h("li", {}, each)))] : h("p", {}, t("loading")))];
  }

  function show() {
    if (!job) return;
    const usable = job.result && job.result.converged !== false && !looksOn(), most = Math.max(1e-6, ...Object.values(left).map((each) => each || 0), (job.result && job.result.error_nominal_mm && job.result.error_nominal_mm.rms) || 0);
    fill(choices, [way, left, kinds, Boolean(failed)], () => ["program", ...kinds].map((each) => {
      const bar = h("i", { className: each === "program" ? "after" : "before" }), mm = left[each];
      bar.style.width = `${Math.max(1, 100 * (mm || 0) / most)}%`;
      return h("label", { className: `choice ${way === each ? "on" : ""}` }, h("input", { type: "radio", name: "way", id: `way-${each}`, checked: way === each, on: { change: () => { way = each; done = null; show(); } } }),
        h("span", {}, h("strong", {}, each === "program" ? t("wayProgram") : t(`export_${each.replace("-", "_")}`)), h("span", { className: "sub" }, each === "program" ? t("wayProgramHint") : t(`way_${each.replace(/^\w+-(?=frames|offsets)/, "").replace("-", "_")}`)),
          typeof mm === "number" ? h("span", { className: "left" }, h("span", { className: "track" }, bar), h("span", {}, t("mmLeft", { mm: number(mm, 2) }))) : h("span", { className: "sub" }, each !== "program" && failed ? t("notForThis") : "")));
    }));
    fill(side, [way, Boolean(listed[way]), notes[way], Boolean(failed)], () => [...aside(), ...(job.kind !== "loop" ? [certificate(id)] : [])]);
    const proven = job.result && job.result.verification, onwards = (kind) => h("a", { className: `btn ${kind}`, id: "to-verify", href: `#/verify/${id}` }, t(proven ? "seeProof" : "proveIt"));
    const state_ = !usable ? "not" : way !== "program" ? (failed ? "not" : "format") : !done ? "choose" : done.refusedOnly ? "refused" : sent ? "sent" : "done";
    body.hidden = !usable;
    foot.set([state_, id, kept, Boolean(proven)], { not: looksOn() ? t("viewerMayNot") : failed ? t("notForThis") : t("noModel"), format: t("formatFoot"), choose: t("chooseFoot"), refused: t("refusedFoot"), done: t("doneFoot"), sent: t("sentFoot") }[state_], () => ({
      choose: [onwards(""), button(t("chooseProgram"), () => file.click(), { id: "choose-program", kind: "primary", ic: "file" })], refused: [button(t("otherFile"), () => file.click()), button(t("keepRefused"), () => correct(true), { id: "keep-refused", kind: "primary", ic: "again" })],
      done: [button(t("downloadCorrected"), download, { id: "download-program", kind: "primary", ic: "down" })], sent: [button(t("otherFile"), () => file.click()), onwards("primary")], format: [onwards(""), button(t("writeFile"), write, { id: "export-model", kind: "primary", ic: "down" })],
      not: [h("a", { className: "btn primary", href: `#/diagnose/${id}` }, t("view_of_diagnose"))],
    }[state_]));
  }

  // What each format would leave, in one answer, after the page is there.
  async function reckonAll() {
    const r = job.result;
    left.program = (r.error_after_mm || (r.verification || {}).error_verified_mm || r.error_identified_mm || r.error_before_mm || {}).rms;
    show();
    try {
      all = await reckoned(`/models/${id}/exports`);
      for (const each of all.exports) { listed[each.kind] = each; left[each.kind] = each.left_mm; }
      kinds = Object.keys(KINDS).filter((each) => listed[each] ? !listed[each].refused : kinds.includes(each));  // no other robot has such a file
    } catch (error) { if (!error.status) throw error; failed = error; }
    show();
  }
  const look = async () => {
    if (!job) {
      job = await ask("GET", `/results/${id}`);
      walk({ job });
      findRun(job).catch(() => {});
      if (job.result && job.result.converged !== false && !looksOn()) reckonAll().catch(() => {});
    }
    show();
  };
  return { look, show };
}

function refusals(targets) {
  return table(t("refusedTargets"), [t("target"), t("line"), t("reason")], targets.slice(0, MOST).map((each) => [each.target, numeric(each.line === null ? "" : String(each.line)), each.reason]));
}

function certificate(id) {
  const names = ["laboratory", "city", "country", "customer", "responsible"], fields = names.map((name) => h("input", { id: `dcc-${name}`, autocomplete: "off", ...(name === "country" ? { maxLength: 2, pattern: "[A-Za-z]{2}" } : { maxLength: 200 }) }));
  return fold(t("dcc"), "XML", h("p", { className: "sub" }, t("dccHint")), h("form", { className: "stack", on: { submit: (event) => {
    event.preventDefault();
    const said = new URLSearchParams(fields.map((input, i) => [names[i], input.value.trim()]).filter(([, value]) => value));
    order(() => save(`/results/${id}/certificate.xml?${said}`, `${id}-certificate.xml`));
  } } }, fields.map((input, i) => labelled(t(`dcc_${names[i]}`), input)), h("div", { className: "row" }, h("button", { className: "btn" }, t("writeFile")))));
}
