// Step 6, Verify: the proof on the robot, at new poses, without and with the correction; of a loop, or of any model that is chosen.

import { ask, reckoned } from "./connection.js";
import { desk, looksOn, moving, order, workOf } from "./desk.js";
import { MODELS, headline, nothingYet } from "./diagnose.js";
import { button, card, fill, fold, footBar, h, head, noteBox, numeric, table } from "./dom.js";
import { control, myName, nameField, openControl, takeControl } from "./lease.js";
import { open as measuring } from "./measure.js";
import { active, findRun, stageOf, walk } from "./road.js";
import { bars } from "./charts.js";
import { enlargement, scenePicture } from "./scene.js";
import { length, number } from "./units.js";
import { t } from "./words.js";

const POSES = 10;

export function open(root, id) {
  if (!id) return nothingYet(root, 6);
  const title = h("h1", { id: "title" }, t("view_of_verify")), says = h("p", { className: "lead", role: "status" }), told = h("div", {}), body = h("div", { className: "stack" }), foot = footBar(t("next")), top = head(t("stepOf", { n: 6 }), title, says);
  const count = h("input", { type: "number", id: "proof-poses", value: POSES, min: 1, max: 500, inputMode: "numeric", on: { input: () => show() } }), seen = h("input", { type: "checkbox", id: "seen", on: { change: () => confirm.classList.remove("miss") } }), who = nameField("starter"), asked = h("label", { className: "field slim" }, h("span", {}, t("yourName")), who);
  const confirm = h("label", { className: "confirm" }, seen, h("span", {}, h("strong", {}, t("lookedIn")), h("span", { className: "sub" }, t("lookedInHint"))));
  const offer = h("div", { className: "cols c7-5" }, card(t("whatMoves"), h("label", { className: "field slim" }, h("span", {}, t("posesToVerify")), count), h("p", {}, t("proofMoves")), h("p", { className: "sub" }, t("proofHow"))), h("div", { className: "stack" }, confirm, asked));
  const picture = scenePicture(t("proofPicture"));
  root.append(top, told, offer, body, foot);
  let model = null, proof = null, inner = null, run = "", again = false, drawn = "";

  // The loop that proves its own model, else the proof of this one.
  const work = () => (model && model.kind === "loop" && (active(model) || (!proof && model.result && model.result.verification)) ? model : proof);
  const subject = () => `/${work().kind === "loop" ? "loops" : "verifications"}/${work().id}`;
  const usable = () => Boolean(model && model.result && model.result.converged !== false && MODELS.includes(model.kind)) || Boolean(proof && !model);

  function show() {
    if (inner) { inner.show(); return; }
    if (!model && !proof) return;
    const of = work(), v = of && of.result && of.result.verification, going = active(of), busy = Boolean(desk.cell && (desk.cell.run_id || workOf(desk.cell))), by = control(), n = Number(count.value);
    const offers = usable() && !going && (!v || again) && Boolean(desk.cell) && !looksOn() && Boolean(model), rests = going && of.state === "paused";
    title.textContent = offers ? t("proveModel") : rests ? t("title_paused") : !v ? t("view_of_verify") : v.error_uncorrected_mm && v.error_verified_mm.rms >= v.error_uncorrected_mm.rms ? t("notBetter") : t("provenTitle");
    says.textContent = v || offers ? "" : going ? (rests ? of.reason : of.step) || "" : usable() ? t("proofHow") : t("noModel");
    offer.hidden = !offers; asked.hidden = by !== "nobody"; confirm.hidden = busy || by === "other";
    fill(told, [of && of.problem, of && of.state, again], () => (of && of.problem && !going && !again ? [noteBox("stop", "alert", of.problem.operator_text, h("p", {}, of.problem.what_to_do))] : []));
    fill(body, [Boolean(v) && of.id, again], () => (v && !again ? sheet(v) : []));
    const state_ = looksOn() ? "looking" : rests ? `rests ${by}` : going ? "going" : offers ? (busy ? "busy" : by === "other" ? "other" : "offer") : v ? "proven" : "not", report = model && model.report;
    foot.set([state_, n, Boolean(report), id], { looking: t("viewerMayNot"), "rests you": t("resumeFoot"), "rests nobody": t("leaseFirst"), going: t("loopGoesOn"), busy: t("robotBusy"), other: t("otherInControl", { name: desk.cell && desk.cell.lease ? desk.cell.lease.holder : "" }), offer: t("next_proof"), proven: t("next_report"), not: "" }[state_] || "", () => {
      const see = (kind) => report && h("a", { className: `btn ${kind}`, id: "open-report", href: `#/report/${model.id}` }, t("openReport")), fresh = (kind) => desk.cell && h("a", { className: `btn ${kind}`, href: "#/prepare" }, t("newCalibration"));
      const halt = button(t("endVerb"), () => order(() => ask("POST", `${subject()}/stop`)), { id: "end-proof", kind: "quiet" });
      return ({
        "rests you": [halt, button(t("resume"), () => order(() => ask("POST", `${subject()}/resume`, {}, moving())), { id: "resume", kind: "primary", ic: "play" })], "rests nobody": [halt, button(t("take"), openControl, { kind: "primary", ic: "user" })],
        busy: [h("a", { className: "btn primary", href: "#/measure" }, t("toRun"))], other: [button(t("takeOverOf", { name: desk.cell && desk.cell.lease ? desk.cell.lease.holder : "" }), openControl, { id: "to-control", kind: "primary", ic: "user" })],
        offer: [see(""), button(t("proveNow", { n }), begin, { id: "prove", kind: "primary", ic: "play" })],
        proven: [model && !looksOn() && desk.cell && button(t("proveAgain"), () => { again = true; show(); }, { id: "prove-again" }), report ? fresh("") : null, see("primary") || fresh("primary")],
        looking: [see("primary")], not: [see(""), fresh("primary")],
      }[state_] || []).filter(Boolean);
    });
  }

  const begin = () => {
    if (!count.reportValidity()) return;
    if (!seen.checked) { confirm.classList.add("miss"); seen.focus(); return; }
    order(async () => {
      if (control() === "nobody") await takeControl(myName(who));
      proof = { ...await ask("POST", "/verifications", { model_id: model.id, poses: Number(count.value), dry_run: false, name: model.name || "" }, moving()), kind: "verification" };
      again = seen.checked = false;
      await look();
    });
  };

  function sheet(v) {
    const r = (model && model.result) || work().result, rows = [[t("rungUncorrected"), v.error_uncorrected_mm, "before"], [t("rungVerified"), v.error_verified_mm, "after"]].filter(([, errors]) => errors);
    const expected = r.error_after_mm || r.error_before_mm, from = v.error_uncorrected_mm ? v.error_uncorrected_mm.rms : (r.error_nominal_mm || v.error_verified_mm).rms, landings = v.landings || [];
    const best = h("div", { className: "accept" }, h("dl", {}, h("div", {}, h("dt", {}, t("measured")), h("dd", {}, `${number(v.error_verified_mm.rms)} mm`), expected ? h("dd", { className: "sub" }, t("diagnosisSaid", { mm: number(expected.rms) })) : null), h("div", {}, h("dt", {}, t("bestPossible")), h("dd", {}, `${number(v.floor_rms_mm)} mm`), h("dd", { className: "sub" }, t("noiseOf")))));
    const next = card(t("whatNext"), h("p", {}, t("keepItSo")), (r.effects || []).map((each) => each.check).filter(Boolean).map((each) => h("p", {}, typeof each === "string" ? each : each.text || "")), h("a", { href: "#/robots", className: "do" }, t("planWatch")));
    if (landings.length) draw(landings).catch((error) => { if (error.status === undefined) throw error; });
    return [h("div", { className: "cols c7-5 sheet" }, h("div", { className: "stack" }, h("section", { className: "card answer-card" }, headline(from, v.error_verified_mm.rms, t("proofCaption", { n: v.poses })), best, bars(t("proofBars"), rows.map(([name, errors, kind]) => [name, errors.rms, `${number(errors.rms)} mm`, kind]))), next),
      landings.length ? card(t("proofPicture"), which(landings), picture) : null),
    landings.length ? fold(t("everyPose"), t("everyPoseNote"), poseTable(landings)) : null,
    fold(t("allFigures"), t("allFiguresNote"), table(t("proofBars"), [t("model"), "n", t("mean"), "RMS", "95 %", t("most")], rows.map(([name, errors]) => [name, numeric(String(errors.n)), ...["mean", "rms", "p95", "max"].map((each) => numeric(number(errors[each])))])), v.refused.length ? h("p", {}, `${t("refusedTargets")}: ${v.refused.join(", ")}`) : null, h("p", { className: "sub" }, v.approach))];
  }

  const which = (landings) => h("fieldset", { className: "row" }, h("legend", { className: "gone" }, t("errorsOf")), [[false, "beforeIt"], [true, "withModel"]].map(([corrected, words]) =>
    h("label", { className: "check" }, h("input", { type: "radio", name: "which", checked: !corrected, on: { change: () => draw(landings, corrected) } }), t(words))));

  async function draw(landings, corrected = false) {
    const scene = await reckoned("/cell/scene").catch((error) => { if (error.status === undefined) throw error; return { capsules: [], obstacles: [] }; }), shown = landings.filter((each) => each.corrected === corrected), most = Math.max(1e-6, ...shown.map((each) => length(each.error_mm))), enlarged = enlargement(most);
    picture.show({ ...scene, arrows: shown.map((each) => ({ at: each.wanted_mm, by: each.error_mm })), enlarged, after: corrected, says: t("proofScale", { n: shown.length, times: enlarged, mm: number(most) }), described: t(corrected ? "arrowsAfter" : "arrowsBefore", { mm: number(most) }) });
  }

  async function look() {
    if (!model && !proof) {
      const job = await ask("GET", `/results/${id}`);
      if (job.kind !== "verification") model = job;
      else { proof = job; model = job.model_id ? await ask("GET", `/results/${job.model_id}`).catch((error) => { if (error.status === 404) return null; throw error; }) : null; }
    } else if (model && active(model)) model = await ask("GET", `/results/${model.id}`);
    if (proof && active(proof)) proof = await ask("GET", `/results/${proof.id}`);
    else if (model && (!proof || proof.model_id === model.id) && !active(model) && (drawn !== model.id || (desk.cell && desk.cell.verification_id))) {  // the newest of this model
      const mine = (await ask("GET", "/verifications")).verifications.find((each) => each.model_id === model.id && !each.dry_run);
      if (mine && (!proof || mine.id > proof.id)) proof = { ...mine, kind: "verification" };
      drawn = model.id;
    }
    const of = work(), shown = model && !active(model) ? { ...model, result: model.result && { ...model.result, verification: (of && of.result && of.result.verification) || null } } : null;
    walk({ ...(shown ? { job: shown } : {}), ...(of && (of.kind === "verification" || active(of)) ? { loop: of } : {}) });
    if (model) await findRun(shown || model);
    const driving = active(of) && stageOf(of) === 5 && of.run_id;
    if (driving && run !== driving) {  // the run of the proof, in the place of the sheet
      if (inner) inner.close();
      run = driving; root.replaceChildren(); inner = measuring(root, run, 6);
    } else if (!driving && inner) {
      inner.close(); inner = null; run = "";
      root.replaceChildren(top, told, offer, body, foot);
    }
    if (inner) await inner.look(); else show();
  }
  return { look, show, close: () => { if (inner) inner.close(); }, shown: () => run };
}

// One row a pose: its targets together, without and with the correction, and what the readings cannot tell apart.
function poseTable(landings) {
  const rms = (rows) => (rows.length ? Math.sqrt(rows.reduce((sum, each) => sum + each.off_mm ** 2, 0) / rows.length) : null), shown = (mm) => numeric(mm === null ? "–" : number(mm));
  return table(t("everyPose"), [t("pose"), t("beforeIt"), t("withModel"), t("most"), t("u2"), t("jointsDeg")], [...new Set(landings.map((each) => each.pose))].map((pose) => {
    const rows = landings.filter((each) => each.pose === pose), after = rows.filter((each) => each.corrected);
    return [String(pose), shown(rms(rows.filter((each) => !each.corrected))), shown(rms(after)), shown(after.length ? Math.max(...after.map((each) => each.off_mm)) : null), shown(Math.max(...rows.map((each) => each.u_mm))), numeric(rows[0].joints_deg.map((each) => number(each, 1)).join(", "))];
  }));
}
