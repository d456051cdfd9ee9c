// The road of a calibration in six steps: what is known of it, and where it has come.

import { ask } from "./connection.js";
import { fill, h, icon, $ } from "./dom.js";
import { number } from "./units.js";
import { causesKnown, errorsOf } from "./ladder.js";
import { t } from "./words.js";

export const STEPS = ["prepare", "check", "measure", "diagnose", "correct", "verify"];
// `plan`: {id, name}; `wish`: {accuracy_mm, minutes}, poses chosen while measuring; `run`; `loop`; `job`: a diagnosis or a loop, with
// its result; `checked`: the plan was found clear; `used`: something was corrected with the model.
const NEW = { plan: null, wish: null, checked: null, run: null, loop: null, job: null, used: "" };
export const road = { ...NEW };

export const afresh = () => Object.assign(road, NEW);

// Walks along with what a view shows: another run or result than before leads to another road.
export function walk({ ...seen }) {
  if (seen.run && ofProof(seen.run, seen.loop)) delete seen.run;
  if (seen.run && road.run && seen.run.id !== road.run.id && !sameLoop(seen.run.id, road.run.id)) Object.assign(road, { run: null, loop: null, job: null });
  if (seen.job && road.job && seen.job.id !== road.job.id) Object.assign(road, { run: null, loop: null });
  Object.assign(road, seen);
}

// A run of a loop has the loop's id before its own.
export const loopOf = (run) => (run.split("-").length > 3 ? run.split("-").slice(0, 3).join("-") : "");
// The run of a proof is no measuring run: its readings are not those of step 3.
export const ofProof = (run, loop) => /-campaign2$/.test(run.id) || Boolean(loop && loop.model_id !== undefined && loopOf(run.id) === loop.id);
const sameLoop = (a, b) => Boolean(loopOf(a)) && loopOf(a) === loopOf(b);

// The step that a loop is at, by its own words; a verification is the last.
export function stageOf(loop) {
  if (loop.model_id !== undefined) return 5;
  const says = loop.step || "";
  return /^campaign 2|corrected targets|verif/i.test(says) ? 5 : /^correct/i.test(says) ? 4 : /^diagnos/i.test(says) ? 3 : 2;
}

const ACTIVE = ["ready", "running", "waiting_for_operator", "paused"];
export const active = (of) => Boolean(of) && ACTIVE.includes(of.state);

export function far() {
  const { plan, wish, checked, run, loop, job } = road;
  if (active(loop) && loop.model_id !== undefined) return 5;
  if (job && job.result) return job.result.verification ? 6 : road.used ? 5 : 4;
  if (loop && active(loop)) return stageOf(loop);
  if (job) return 3;
  if (run && !run.dry_run) return run.state === "succeeded" ? 3 : 2;
  return checked ? 2 : plan || wish ? 1 : 0;
}

function sayings(at) {
  const { plan, wish, run, job } = road, r = job && job.result, errors = r ? errorsOf({ ...job, result: { ...r, verification: null } }) : {}, ask_ = run && run.state === "waiting_for_operator";
  const two = (a, b) => `${number(a, 2)} → ${number(b, 2)} mm`;
  return [
    wish ? `${number(wish.accuracy_mm, 2)} mm` : plan ? plan.name || t("fixedPlan") : at === 0 ? t("say_prepare") : "",
    at > 1 && (road.checked || run) ? t("say_checked") : at === 1 ? t("say_check") : "",
    run && !run.dry_run ? (ask_ ? t("asksYou") : run.state === "running" || run.state === "succeeded" ? t("doneOf", { done: run.done, total: run.total }) : t(`state_${run.state}`)) : job ? t("say_uploaded") : "",
    r && errors.last !== null && errors.first !== null ? two(errors.first, errors.last) : r ? t(!causesKnown(r) ? "say_not_known" : (r.effects || []).length ? "say_cause" : "say_no_cause") : at === 3 ? t("say_diagnose") : "",
    road.used || (at === 4 ? t("say_correct") : at === 6 && job && job.kind === "loop" ? t("say_corrected") : ""),
    r && r.verification ? two(r.verification.error_uncorrected_mm?.rms, r.verification.error_verified_mm.rms) : "",
  ];
}

const addresses = () => {
  const { plan, run, loop, job } = road, result = job ? job.id : loop ? loop.id : "";
  return ["prepare", plan ? `check/${plan.id}` : "check", run && !run.dry_run ? `measure/${run.id}` : "measure", ...["diagnose", "correct", "verify"].map((step) => (result ? `${step}/${result}` : step))];
};
export const addressOf = (step) => `#/${addresses()[STEPS.indexOf(step)]}`;

export function showRail(view) {
  const at = far(), says = sayings(at), to = addresses(), busy = road.run, asks = at === 2 && busy && busy.state === "waiting_for_operator", bad = at === 2 && busy && ["stopped", "failed"].includes(busy.state);
  fill($("steps"), [at, says, to, view, asks, bad], () => STEPS.map((step, n) => {
    const now = n === at, state = n < at ? "done" : now ? "now" : "todo";
    return h("li", { className: `${state} ${now && asks ? "warn" : ""} ${now && bad ? "bad" : ""}` }, h("a", { href: `#/${to[n]}`, "data-name": step, "aria-current": step === view ? "step" : null },
      h("span", { className: "gone" }, `${t(`rail_${state}`)}: `), h("span", { className: "num", "aria-hidden": "true" }, state === "done" ? icon("check") : now && (asks || bad) ? icon("alert") : String(n + 1)),
      h("span", { className: "txt" }, h("span", { className: "name" }, t(`view_of_${step}`)), h("span", { className: "say" }, says[n] || (state === "todo" ? t("notYet") : "")))));
  }));
}

// The run behind a result, and its plan's name, for a page that was opened at the result.
export async function findRun(job) {
  if (!job || road.job !== job || (road.run && !active(road.run))) return;
  const { run_id: id } = job.kind === "loop" ? { run_id: (job.runs || [])[0] } : job.dataset_id ? await ask("GET", `/datasets/${job.dataset_id}`).catch(() => ({})) : {};
  if (id && road.job === job) road.run = await ask("GET", `/runs/${id}`).catch(() => null);
}
