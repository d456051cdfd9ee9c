// Step 4, Diagnose: the answer first (from, to, verdict, cause, what to check, what next), the evidence folded below.

import { acceptance, acceptanceTable, asked, limits } from "./acceptance.js";
import { ask, key, reckoned, save } from "./connection.js";
import { desk, looksOn, order } from "./desk.js";
import { button, card, fill, fold, footBar, h, head, noteBox, numeric, table } from "./dom.js";
import { withU } from "./history.js";
import { causesKnown, errorTable, judged, ladder } from "./ladder.js";
import { control, openControl } from "./lease.js";
import { deletion, menu } from "./menu.js";
import { active, addressOf, findRun, road, stageOf, walk } from "./road.js";
import { enlargement, scenePicture } from "./scene.js";
import { duration, length, moment, number, state } from "./units.js";
import { t } from "./words.js";

export const MODELS = ["identification", "diagnosis", "loop"];
const COLLECTIONS = { identification: "identifications", diagnosis: "diagnoses" };

// Without a result: that of the road, or what to do first.
export function nothingYet(root, step) {
  const id = road.job ? road.job.id : road.loop ? road.loop.id : "", foot = footBar(t("next"));
  root.append(head(t("stepOf", { n: step }), h("h1", { id: "title" }, t(`view_of_${["diagnose", "correct", "verify"][step - 4]}`)), h("p", { className: "lead" }, t("nothingMeasured"))), foot);
  if (id) { location.replace(`${location.hash}/${id}`); }
  foot.set([], "", () => [h("a", { className: "btn quiet", href: "#/data" }, t("view_of_data")), desk.cell && h("a", { className: "btn primary", href: addressOf("measure") }, t("view_of_measure"))].filter(Boolean));
  return { look: async () => {}, show: () => {} };
}

// The error before and after, as large as it is read from two metres.
export const headline = (from, to, caption) => h("div", { className: "headline" }, h("p", { className: "answer" }, h("span", { className: "was" }, number(from, 2)), h("span", { className: "to", ariaHidden: "true" }, "→"), h("span", { className: "now" }, number(to, 2)), h("span", { className: "unit" }, "mm")),
  h("p", { className: "sub" }, caption, " ", to > 0 && from / to > 1.5 ? h("strong", {}, t("timesBetter", { n: number(from / to, from / to < 10 ? 1 : 0) })) : null));

// The name of an effect in words, as far as there are any: the label alone says little.
const meaningOf = (each) => each.meaning || each.label;

export function open(root, id) {
  if (!id) return nothingYet(root, 4);
  const title = h("h1", { id: "title" }, t("view_of_diagnose")), says = h("p", { className: "lead", id: "job", role: "status" }), bar = h("progress", { ariaLabel: t("working"), hidden: true }), steps = h("ol", { className: "log" }), body = h("div", { className: "stack" }), foot = footBar(t("next"));
  const picture = scenePicture(t("arrowPicture")), space = card(t("arrowPicture"), picture);
  const options = menu(() => !job ? [] : [
    job.report && { text: t("reportFile"), id: "report-file", act: () => order(() => save(`/reports/${id}`, `${id}-report.html`)) },
    job.result && job.result.converged !== false && MODELS.includes(job.kind) && { text: t("modelFile"), id: "model-file", act: () => order(() => save(`/models/${id}`, `${id}-model.json`)) },
    ...((job.run_id ? [job.run_id] : job.runs || []).map((each) => ({ text: `${t("toRun")} ${each.split("-").slice(3).join(" ")}`, act: () => { location.hash = `#/measure/${each}`; } }))),
    job.dataset_id && !looksOn() && !active(job) && { text: t("identify"), id: "identify", act: () => order(() => again("identification")) },
    job.kind !== "loop" && !active(job) && deletion(`/results/${id}`, titleOf(), "#/data"),
  ]);
  root.append(head(t("stepOf", { n: 4 }), title, says, options), bar, steps, body, foot);
  let job = null, drawn = false, watched = false;
  const titleOf = () => [t(`kind_${job.kind}`), job.name, moment(new Date(job.created_utc))].filter(Boolean).join(" · ");

  async function again(kind) {
    const made = await ask("POST", `/${COLLECTIONS[kind]}`, { dataset_id: job.dataset_id, ...asked() }, key());
    location.hash = `#/diagnose/${made.id}`;
  }
  const goOn = () => order(() => ask("POST", `/loops/${id}/resume`, {}, { ...(desk.lease ? { "Lease-Id": desk.lease.lease_id } : {}), ...key() }));

  function headlineOf() {
    const r = job.result;
    return !r ? "" : r.acceptance && r.acceptance.verdict === "rejected" ? t("foundButRejected") : r.verdict ? t(`verdict_${r.verdict}`) : t("identified");
  }

  function show() {
    if (!job) return;
    const busy = active(job), since = (Date.now() - new Date(job.created_utc)) / 1000, by = control();
    const heading = busy ? t(job.kind === "loop" && job.state === "paused" ? "title_paused" : "diagnosingNow") : job.result ? headlineOf() : state(job.state);
    if (title.textContent !== heading) title.textContent = heading;
    title.dataset.state = job.state;
    const line = busy ? [job.reason || job.step || (job.state === "ready" ? t("waitsForTurn") : ""), t("sinceThen", { time: duration(since) })].filter(Boolean).join(" · ") : titleOf();
    if (says.textContent !== line) says.textContent = line;
    bar.hidden = !busy || job.state === "paused";
    fill(steps, [busy, job.steps || []], () => (busy || !job.result ? (job.steps || []).map((each) => h("li", {}, each)) : []));
    options.show();
    fill(body, [job.state, looksOn()], () => {
      if (job.problem) return [noteBox("stop", "alert", job.problem.operator_text, h("p", {}, job.problem.what_to_do))];
      if (!job.result) return job.reason && !busy ? [noteBox("info", "info", job.reason)] : [];
      return MODELS.includes(job.kind) ? findings() : [];
    });
    const usable = job.result && job.result.converged !== false && MODELS.includes(job.kind), proven = job.result && job.result.verification;
    const state_ = busy ? (job.kind !== "loop" ? "busy" : job.state === "paused" ? `loop ${by}` : "loop") : usable ? (proven ? "proven" : "usable") : "not";
    foot.set([state_, looksOn(), id], { busy: t("nothingMoves"), loop: t("loopGoesOn"), "loop you": t("resumeFoot"), "loop nobody": t("leaseFirst"), usable: t("next_correct"), proven: t("next_report"), not: job.report ? t("next_report") : t("overFoot") }[state_] || "", () => {
      const report = (kind) => job.report && h("a", { className: `btn ${kind}`, id: "open-report", href: `#/report/${id}` }, t("openReport"));
      if (state_ === "loop" && !looksOn()) return [button(t("pause"), () => order(() => ask("POST", `/loops/${id}/pause`, undefined, key())), { id: "loop-pause", kind: "primary-wait", ic: "pause" })];
      if (state_ === "loop you") return [button(t("resume"), goOn, { id: "loop-resume", kind: "primary", ic: "play" })];
      if (state_.startsWith("loop ") && !looksOn()) return [button(t("take"), openControl, { kind: "primary", ic: "user" })];
      return { usable: [report(""), h("a", { className: "btn primary", id: "to-correct", href: `#/correct/${id}` }, t("correctPrograms"))], proven: [h("a", { className: "btn", href: `#/verify/${id}` }, t("seeProof")), report("primary")],
        not: [report("primary") || h("a", { className: "btn primary", href: desk.cell ? "#/prepare" : "#/data" }, t(desk.cell ? "newCalibration" : "view_of_data"))] }[state_] || [];
    });
  }

  function findings() {
    const r = job.result, { by, poses, first, last } = judged(job), known = causesKnown(r), causes = (r.effects || []).filter((each) => !each.imitates), imitated = (r.effects || []).filter((each) => each.imitates), carried = (r.carried || []).filter((each) => each.confirmed);
    const remarks = [...(r.warnings || []), ...(r.notes || [])], next = (r.follow_up || []).filter((each) => each.campaign);
    const answer = h("section", { className: "card answer-card" }, first !== null ? headline(first, last, poses ? t("judgedOnRobot", { n: poses }) : t("ladderHint")) : null, acceptance(r.acceptance), ladder(by), r.finding ? h("p", { id: "finding" }, r.finding) : null);
    const cause = !r.effects ? null : card(causes.length ? t("effects") : imitated.length ? t("imitatedBy") : t(known ? "noEffects" : "notKnown"), causes.length || imitated.length ? [...causes, ...imitated].map(effect) : h("p", {}, t(known ? "noEffectsHint" : "notKnownHint")), carried.length ? [h("h3", {}, t("carriedTerms")), h("ul", { className: "plain" }, carried.map((each) => h("li", {}, each.finding)))] : null);
    const todo = (r.next_measurements || []).length || next.length ? card(t("whatNext"), (r.next_measurements || []).length ? h("ol", { className: "plain" }, r.next_measurements.map((each) => h("li", {}, each))) : null,
      next.length && !looksOn() ? [h("p", {}, t("followUpHint")), next.map((each) => button(t("keepCampaign"), () => order(async () => {
        const kept = await ask("POST", "/campaigns", { campaign: each.campaign, name: `follow-up of ${id}` }, key());
        location.hash = `#/check/${kept.id}`;
      })))] : null) : null;
    return [h("div", { className: "cols c7-5 sheet" }, h("div", { className: "stack" }, answer, cause, todo), h("div", { className: "stack" }, space)),
      fold(t("allFigures"), t("allFiguresNote"), errorTable(job)),
      r.acceptance ? fold(t("howDecided"), t("acceptance"), acceptanceTable(r.acceptance)) : null,
      (r.power || []).length ? fold(t("power"), t("powerN", { n: r.power.length }), h("p", { className: "sub" }, t("powerHint")), powerTable(r.power)) : null,
      remarks.length ? fold(t("remarks", { n: remarks.length }), "", h("ul", { className: "plain" }, remarks.map((each) => h("li", {}, each)))) : null,
      job.dataset_id && !looksOn() ? fold(t("diagnoseAgain"), "", limits(), h("div", { className: "row" }, button(t("diagnose"), () => order(() => again("diagnosis")), { id: "again-diagnose" }))) : null].filter(Boolean);
  }

  async function draw() {
    drawn = true;
    const [found, scene] = [await reckoned(`/results/${id}/arrows`), await reckoned("/cell/scene").catch(() => ({ capsules: [], obstacles: [] }))];
    if (!found.arrows.length) { picture.replaceWith(h("p", {}, t("noArrows"))); return; }
    let which = "nominal_mm";
    const both = () => {
      const most = Math.max(...found.arrows.map((each) => length(each[which]))), enlarged = enlargement(most);
      picture.show({ ...scene, arrows: found.arrows.map((each) => ({ at: each.at_mm, by: each[which] })), enlarged, after: which === "model_mm",
        says: t(found.held_out ? "arrowScale" : "arrowScaleFitted", { n: found.arrows.length, times: enlarged, mm: number(most) }), described: t(which === "nominal_mm" ? "arrowsBefore" : "arrowsAfter", { mm: number(most) }) });
      picture.dataset.arrows = String(found.arrows.length);
    };
    const choice = (value, words) => h("label", { className: "check" }, h("input", { type: "radio", name: "which", value, checked: value === which, on: { change: () => { which = value; both(); } } }), words);
    picture.before(h("fieldset", { className: "row" }, h("legend", { className: "gone" }, t("errorsOf")), choice("nominal_mm", t("beforeIt")), choice("model_mm", t("withModel"))));
    both();
  }

  const look = async () => {
    if (!job || active(job)) {
      job = await ask("GET", `/results/${id}`);
      if (["watch_plan", "watch", "upkeep"].includes(job.kind)) { location.replace(`#/watch/${id}`); return; }
      walk({ job: active(job) && job.kind === "loop" ? null : job, ...(job.kind === "loop" ? { loop: job } : {}) });
      await findRun(job);
    }
    watched = watched || active(job);
    show();
    if (watched && job.kind === "loop" && active(job) && job.run_id && stageOf(job) !== 3 && desk.cell && desk.cell.run_id === job.run_id) location.replace(stageOf(job) === 5 ? `#/verify/${id}` : `#/measure/${job.run_id}`);
    if (watched && job.kind === "loop" && job.state === "succeeded" && job.result && job.result.verification) location.replace(`#/verify/${id}`);
    if (!drawn && job.result && picture.isConnected) await draw().catch((error) => { if (error.status === 404) picture.replaceWith(h("p", {}, t("noArrows"))); else { drawn = false; throw error; } });
  };
  return { look, show };
}

// One row a kind of effect, one column a joint; what acts on no joint stands in the first.
function powerTable(power) {
  const kinds = new Map(), joints = new Set();
  for (const { label, smallest, unit } of power) {
    const [kind, , joint] = label.match(/^(.*?)(:j(\d+))?$/).slice(1), row = `${kind}, ${unit}`;
    if (joint) joints.add(Number(joint));
    if (!kinds.has(row)) kinds.set(row, {});
    kinds.get(row)[joint || ""] = smallest === null ? t("notSeen") : number(smallest, smallest >= 100 ? 0 : 3);
  }
  const columns = [...joints].sort((a, b) => a - b), some = [...kinds.values()].some((row) => row[""] !== undefined);
  return table(t("power"), [t("effect"), ...(some ? [t("noJoint")] : []), ...columns.map((joint) => `${t("joint")} ${joint}`)],
    [...kinds].map(([name, row]) => [name, ...(some ? [""] : []), ...columns].map((joint, i) => (i ? numeric(row[joint] ?? "") : joint))));
}

function effect(each) {
  const { value, std, unit } = each.amplitude || {}, check = each.check && (typeof each.check === "string" ? each.check : each.check.text || "");
  const rivals = Object.entries(each.candidates || {}).filter(([label]) => label !== each.label);
  return h("article", { className: "effect" }, h("h3", { className: "h-big" }, meaningOf(each)), h("p", { className: "sub" }, each.label),
    h("p", {}, `${t("size")}: ${withU(value, 2 * std, unit || "")} (U, k = 2). `, t("explains", { percent: number(100 * (each.evidence.explained_variance || 0), 0) })),
    rivals.length && !each.imitates ? h("p", {}, `${t("orElse")}: ${rivals.map(([label, weight]) => `${label} (${number(100 * weight, 0)} %)`).join(", ")}`) : null,
    check ? h("div", { className: "todo" }, h("strong", {}, t("checkIt")), h("p", {}, check)) : null);
}
