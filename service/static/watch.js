// The view Watch: a plan of check poses, the verdict on a watch, or an upkeep, and what comes next.

import { ask, key } from "./connection.js";
import { link } from "./data.js";
import { looksOn, order } from "./desk.js";
import { button, fill, fold, h, head, numeric, table } from "./dom.js";
import { deletion, menu } from "./menu.js";
import { causeName, stateOf, withU } from "./history.js";
import { baselineOf, judgeForm } from "./judging.js";
import { duration, moment, number, sign, state } from "./units.js";
import { t } from "./words.js";

const WATCHED = ["watch_plan", "watch", "upkeep"];

export function open(root, id) {
  if (!id) { location.hash = "#/robots"; return { look: async () => {}, show: () => {} }; }
  const title = h("h1", { id: "title" }, t("documents")), says = h("p", { className: "big", id: "job", role: "status" }), step = h("p", { id: "step" }), bar = h("progress", { ariaLabel: t("working"), hidden: true }), body = h("div", { className: "stack" });
  let job = null, judge = null;
  const options = menu(() => [job && !["ready", "running"].includes(job.state) && deletion(`/results/${id}`, title.textContent, "#/robots")]);
  root.append(head("", title, says, options), step, bar, body);
  const show = () => {
    if (!job) return;
    const busy = ["ready", "running"].includes(job.state);
    title.textContent = `${t(`kind_${job.kind}`)} · ${moment(new Date(job.created_utc))}`;
    says.textContent = `${sign(job.state)} ${state(job.state)}`;
    step.textContent = busy ? [job.step || t("waitsForTurn"), t("sinceThen", { time: duration((Date.now() - new Date(job.created_utc)) / 1000) })].join(" · ") : "";
    bar.hidden = !busy; options.show();
    fill(body, [job.state, looksOn()], () => {
      const parts = job.problem ? [h("section", { className: "card bad" }, h("p", {}, h("strong", {}, "✖ ", job.problem.operator_text)), h("p", {}, `${t("whatToDo")} `, job.problem.what_to_do))] : [];
      if (job.result) parts.push(...(job.kind === "watch_plan" ? planned(job) : job.kind === "watch" ? judged(job) : keptUp(job)));
      if (!looksOn() && job.kind === "watch_plan" && job.result) {
        judge = judgeForm(() => baselineOf(job.baseline.id));
        parts.push(h("section", { className: "card" }, h("h2", {}, t("judgeReadings")), h("p", { className: "sub" }, t("judgeHint")), judge));
      }
      return parts;
    });
  };
  const look = async () => {
    if (!job || ["ready", "running"].includes(job.state)) job = await ask("GET", `/results/${id}`);
    if (!WATCHED.includes(job.kind)) { location.hash = `#/diagnose/${id}`; return; }
    show();
    if (judge && judge.isConnected) await judge.look();
  };
  return { look, show };
}

const words = (text) => h("span", { className: "words" }, text);
const size = (value, unit, none = t("notSeen")) => (typeof value === "number" ? `${Number(value.toPrecision(2))} ${unit}`.replace("-", "−") : none);

function planned(job) {
  const r = job.result, wide = { className: "card" };
  const keep = button(t("keepCampaign"), () => order(async () => {
    const kept = await ask("POST", "/campaigns", { campaign: r.campaign, name: `watch ${job.id.slice(0, 8)}` }, key());
    location.hash = `#/check/${kept.id}`;
  }), { id: "keep-campaign", kind: "primary", ic: "arrow" });
  return [h("section", wide, h("h2", {}, t("watchShows")), h("p", {}, t("watchShowsHint", { poses: r.poses_deg.length / r.rounds, visits: r.rounds, readings: r.readings, targets: r.targets.join(", "), percent: number(100 * r.false_alarms, 1) })),
    table(t("watchShows"), [t("lastCause"), t("seenFrom"), t("aloneFrom"), t("neverApart")], r.causes.map((each) => [causeName(each.label), numeric(size(each.seen_from, each.unit)), numeric(size(each.alone_from, each.unit, t("neverAlone"))), each.never_apart_from.map(causeName).join(", ") || "–"])),
    r.in_words ? h("p", {}, r.in_words) : null,
    r.not_seen.length ? h("p", {}, `${t("notSeenCauses")}: ${r.not_seen.map(causeName).join(", ")}`) : null, r.nests ? h("p", {}, t("nestsSeen", { mm: number(r.nests.seen_from_mm), limit: number(r.nests.limit_mm) })) : null,
    r.proposals.length ? fold(t("toSeeMore"), "", table(t("toSeeMore"), [t("targets"), t("visitsEach"), t("readings"), t("seesAll"), t("seenWorst")], r.proposals.map((each) => [each.targets.join(", "), each.rounds, each.readings, each.reached ? "✔" : "–", `${causeName(each.worst.label)} ${size(each.worst.seen_from, r.causes.find((cause) => cause.label === each.worst.label).unit)}`]))) : null),
  h("section", wide, h("h2", {}, t("nextSteps")), h("p", {}, t("watchNext")), looksOn() ? null : h("div", { className: "row" }, keep))];
}

const updated = (job) => (job.result.updated_model ? h("div", { className: "row" }, link(t("updatedModel"), `/models/${job.id}`, `${job.id}-model.json`), h("span", { className: "sub" }, t("updatedHint"))) : null);
const notes = (r) => (r.notes.length ? h("section", { className: "card" }, h("h2", {}, t("notes")), h("ul", {}, r.notes.map((each) => h("li", {}, each)))) : null);
// A robot is asked for by its serial number too, where an address can hold it.
function whose(r) {
  const serial = (r.device.find((each) => each.role === "robot") || {}).serial || "", addressed = /^[0-9A-Za-z][0-9A-Za-z-]{0,63}$/.test(serial);
  return h("p", {}, addressed ? h("a", { href: `#/robot/${serial}`, className: "do" }, `${t("robot")} ${serial}`) : serial, " ", h("span", { className: "sub" }, [r.robot, r.measured && r.measured.began, r.data].filter(Boolean).join(" · ")));
}

function judged(job) {
  const r = job.result, wide = { className: "card" };
  return [h("section", wide, h("h2", {}, t("verdict")), h("p", { className: "big" }, stateOf(r.verdict)), h("p", { className: "big" }, `${t("whatToDo")} `, r.advice), h("p", {}, r.in_words), whose(r), updated(job)),
    r.causes.length ? h("section", wide, h("h2", {}, t("lastCause")), table(t("lastCause"), [t("lastCause"), t("size"), t("shareOfClass"), t("inWords")], r.causes.map((each) => [causeName(each.label), numeric(withU(each.size.value, each.size.u, each.size.unit)), numeric(`${number(100 * (each.weight || 0), 0)} %`), words(each.in_words)]))) : null,
    h("section", wide, h("h2", {}, t("howSure")), h("p", {}, t("errorAtPoses", { rms: withU(r.error_mm.rms, r.error_mm.u, "mm"), max: number(r.error_mm.max) })),
      table(t("howSure"), [t("watchesCounted"), t("alarm"), "T²", t("itsLimit"), "p", t("itsLimit")], r.questions.map((each) => [each.watches, each.alarm ? `✖ ${t("yes")}` : `✔ ${t("no")}`, numeric(number(each.t_squared, 1)), numeric(number(each.t_squared_limit, 1)), numeric(probability(each.p_value)), numeric(probability(each.p_limit))]))), notes(r)].filter(Boolean);
}

const probability = (p) => (typeof p !== "number" ? "–" : p < 1e-12 ? "< 1e−12" : p < 1e-3 ? p.toExponential(1).replace("-", "−") : number(p));

function keptUp(job) {
  const r = job.result, wide = { className: "card" };
  return [h("section", wide, h("h2", {}, t("kind_upkeep")), h("p", { className: "big" }, r.thermal ? `✔ ${t("said_thermal")}` : `✖ ${t("said_not thermal")}`), h("p", { className: "big" }, `${t("whatToDo")} `, r.advice), h("p", {}, r.in_words), whose(r), updated(job),
    table(t("thermalParameters"), [t("parameter"), t("before"), t("value"), t("unit")], r.parameters.map((each) => [each.name, numeric(number(each.before)), numeric(withU(each.value, each.u)), each.unit])), r.instead.length ? h("p", {}, `${t("lastCause")}: ${r.instead.map(causeName).join(", ")}`) : null), notes(r)].filter(Boolean);
}
