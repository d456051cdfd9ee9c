// The view Run: state, prompt, last reading, drift and errors, the poses with what each is worth, and the events.

import { ask, connection, reckoned } from "./connection.js";
import { strip } from "./charts.js";
import { asPlanned, counted, driftsOf } from "./counted.js";
import { desk, looksOn, moving, order, reasonOf } from "./desk.js";
import { button, fill, h, svg } from "./dom.js";
import { eventList } from "./eventlist.js";
import { follow } from "./events.js";
import { given } from "./given.js";
import { leasePanel } from "./lease.js";
import { legend, marks } from "./plan.js";
import { poseList } from "./poses.js";
import { promptCard } from "./prompt.js";
import { scenePicture } from "./scene.js";
import { duration, length, minus, moment, number, sign, state, timeLeft } from "./units.js";
import { t } from "./words.js";

const ENDED = ["succeeded", "failed"], MOST_RUNS = 200, REPLAN_MS = 3000, LIST_MS = 5000;

// What an order concerns: the loop that has the robot, else the run that is shown.
const subject = (run) => (desk.cell && desk.cell.loop_id && run.id.startsWith(desk.cell.loop_id) ? `/loops/${desk.cell.loop_id}` : `/runs/${run.id}`);

export function open(root, id) {
  const chooser = h("select", { id: "runs", on: { change: () => { location.hash = `#/run/${chooser.value}`; } } });
  const [says, why, step] = [h("div", { id: "state", role: "status" }), h("p", { id: "why" }), h("p", { id: "step", className: "dim" })];
  const bar = h("progress", { id: "bar", max: 1, value: 0, ariaLabel: t("readingsDone") }), [done, left] = [h("span", { id: "done" }), h("span", { id: "left", className: "push" })];
  const pause = button(t("pause"), () => order(() => ask("POST", `${subject(run)}/pause`)), { id: "pause", disabled: true });
  const goOn = (body) => ask("POST", `${subject(run)}/resume`, body, moving());
  const resume = button(t("resume"), () => order(() => goOn()), { id: "resume", disabled: true });
  const restation = button(t("restation"), () => order(() => ask("POST", `/runs/${run.id}/restation`, { reason: "told on the operator page" }, moving())), { id: "restation", disabled: true });
  const exchanged = h("input", { id: "exchanged", maxLength: 500, size: 24 });
  const accept = button(t("accept"), () => order(async () => {
    const reason = exchanged.value.trim();
    if (!reason) { exchanged.focus(); throw new Error(t("sayWhyExchanged")); }
    await goOn({ accept_other: another(), reason });
    exchanged.value = "";
  }), { id: "accept", disabled: true });
  const individual = h("div", { id: "individual", className: "row", hidden: true }, h("label", {}, t("reason"), " ", exchanged), accept, h("span", { className: "dim" }, t("acceptHint")));
  const card = promptCard(), lease = leasePanel(), files = given(), list = eventList(), picture = scenePicture(t("runPicture"));
  const reading = h("div", { id: "reading" }), drift = svg("svg", { id: "drift", role: "img", class: "strip" }), errors = svg("svg", { id: "errors", role: "img", class: "strip" }), off = h("p", { id: "off", className: "dim" });
  const poses = poseList(() => run, () => look(true));
  const wide = { className: "wide" };
  const desks = h("div", { id: "run", className: "views" },
    card,
    h("section", {}, h("h2", {}, h("label", { htmlFor: "runs" }, t("run"))), h("div", { className: "row" }, chooser), says, why, step, bar, h("div", { className: "row" }, done, left),
      h("div", { className: "row" }, pause, resume, restation), individual),
    h("section", {}, h("h2", {}, t("lastReading")), reading), lease, files,
    h("section", { className: "picture" }, h("h2", {}, t("runPicture")), picture, legend()),
    h("div", { className: "strips" }, h("section", {}, h("h2", {}, t("drift")), drift, off), h("section", {}, h("h2", {}, t("errors")), errors, h("p", { className: "dim" }, t("errorsHint")))),
    poses, h("section", wide, h("h2", {}, t("events")), list));
  const none = h("section", wide, h("p", { className: "big" }, t("noRun")), h("p", {}, h("a", { href: "#/campaigns", className: "do" }, t("toCampaigns"))));
  root.append(none, desks);
  none.hidden = desks.hidden = true;

  let run = null, plan = null, scene = null, planned = 0, drifts = {}, offs = {}, expected = new Map(), told = [], runs = [], listed = 0;
  const control = new AbortController();

  // The serial number of another robot or instrument than that of the record, which has kept the run from going on.
  function another() {
    const of = subject(run).startsWith("/loops/") ? desk.loop && desk.loop.problem : run.error;
    return run.state === "paused" && of && of.name === "OtherIndividual" ? of.serial : "";
  }

  function hear(events) {
    told.push(...events.filter((each) => ["reading", "measure_again"].includes(each.kind)));
    list.add(events); judge(); strips();
    desk.look().catch(() => {});  // the band says it
  }

  // Readings against what the nominal robot predicts; a plan that came later, or has changed, judges them all anew.
  function judge() {
    const readings = counted(told);
    offs = {}; drifts = driftsOf(readings);
    for (const { data, utc } of readings) {
      const where = expected.get(data.pose) || expected.get(`${data.name} ${data.target}`);
      if (where) (offs[t(`set_${data.set}`)] = offs[t(`set_${data.set}`)] || []).push({ utc, y: length(minus(asPlanned(data), where)) });
    }
  }

  function strips() {
    const noise = plan && plan.noise_mm, within = plan && plan.expected_within_mm;
    strip(drift, drifts, { limit: noise ? { mm: noise, words: t("noiseLimit", { mm: number(noise) }) } : null, name: t("driftDescribed") });
    const most = Math.max(0, ...Object.values(offs).flat().map((each) => each.y));
    strip(errors, offs, { limit: within && within < 4 * most ? { mm: within, words: t("withinLimit", { mm: number(within, 0) }) } : null, name: t("errorsDescribed"), joined: false });
  }

  function show() {
    if (!run) return;
    lease.show();
    const active = ["running", "waiting_for_operator"].includes(run.state), looking = looksOn(), { silent } = connection;
    says.textContent = `${sign(run.state)} ${state(run.state)}${run.dry_run ? ` (${t("dryRunShort")})` : ""}`;
    says.dataset.state = run.state;
    fill(why, [run.prompt ? "" : run.reason, run.error], () => (run.prompt ? [] : reasonOf(run, desk.cell)));
    step.textContent = desk.loop && run.id.startsWith(desk.loop.id) ? `${t("loop")}: ${desk.loop.step}` : "";
    bar.max = Math.max(run.total, 1); bar.value = run.done;
    done.textContent = t("doneOf", { done: run.done, total: run.total }) + (run.skipped ? `, ${t("skippedOf", { n: run.skipped })}` : "");
    left.textContent = silent ? "" : run.dry_run && run.seconds_left ? t("wouldTake", { time: duration(run.seconds_left) }) : [warming(), timeLeft(run, looking)].filter(Boolean).join(" · ");
    pause.disabled = silent || !active;
    resume.disabled = silent || !(["paused", "stopped", "ready"].includes(run.state) && desk.lease) || run.dry_run;
    restation.disabled = silent || looking || run.dry_run || ENDED.includes(run.state);
    individual.hidden = !another() || looking; accept.disabled = !desk.lease;
    for (const each of [pause, resume, restation, lease, list.parentElement]) each.hidden = run.dry_run;
    off.textContent = run.drift ? t("driftNow", { now: number(run.drift.off_mm), most: number(run.drift.most_mm), n: run.drift.readings }) : t("driftNone");
    showReading(run.last_reading);
    card.show(run, scene);
    poses.show(plan, run); files.show();
  }

  // Until when the arm is warming up: the last word of the record about it that nothing has followed.
  function warming() {
    const until = list.warmingUntil();
    if (run.state !== "running" || !until) return "";
    return run.simulated ? t("warmingFast") : until > new Date() ? t("warming", { at: moment(until) }) : "";
  }

  function showReading(data) {
    const where = data && (expected.get(data.pose) || expected.get(`${data.name} ${data.target}`)), by = where && data.world_mm ? minus(asPlanned(data), where) : null;
    const rows = !data ? [] : [[t("pose"), data.name], [t("set"), t(`set_${data.set}`)], [t("target"), data.target],
      ...(data.world_mm || []).map((x, i) => [t("worldMm", { axis: "xyz"[i] }), number(x) + (by ? `  (${by[i] < 0 ? "−" : "+"}${number(Math.abs(by[i]))})` : "")]),
      ...(typeof data.length_mm === "number" ? [[t("lengthTo", { base: data.base_target }), `${number(data.length_mm, 4)} mm`]] : []),
      ...(typeof data.t_air_c === "number" ? [[t("air"), `${number(data.t_air_c, 2)} °C`]] : [])];
    fill(reading, [rows, by], () => !data ? h("p", {}, t("noneYet")) : [
      by && h("p", { className: "big" }, t("residual", { mm: number(length(by)) }), h("small", {}, ` ${t("against")}`)),
      h("table", {}, h("tbody", {}, rows.map(([name, value]) => h("tr", {}, h("th", { scope: "row" }, name), h("td", { className: "n" }, value)))))]);
  }

  // The list is older than the run that is shown: of that its own state counts.
  function choices() {
    const known = runs.map((each) => (each.id === run.id ? run : each));
    fill(chooser, known.map((each) => [each.id, each.state]), () => known.slice(0, MOST_RUNS).map((each) => h("option", { value: each.id }, `${each.name} · ${each.id.slice(0, 15)} · ${state(each.state)}${each.dry_run ? ` (${t("dryRunShort")})` : ""}`)));
    chooser.value = id;
  }

  async function look(again = false) {
    if (!id || Date.now() - listed > LIST_MS) { ({ runs } = await ask("GET", "/runs")); listed = Date.now(); }
    if (!id) {
      const at = desk.cell && desk.cell.run_id ? desk.cell.run_id : desk.cell && desk.cell.loop_id ? null : runs.length ? runs[0].id : null;
      if (at) { history.replaceState(null, "", `#/run/${at}`); dispatchEvent(new HashChangeEvent("hashchange")); return; }
      none.hidden = false; none.firstChild.textContent = desk.loop ? `${t("loop")}: ${desk.loop.step}` : t("noRun");
      return;
    }
    run = await ask("GET", `/runs/${id}`);
    desks.hidden = false; choices();
    show();
    if (!scene && desk.cell) scene = await reckoned("/cell/scene").catch(() => null);
    const changed = plan && !run.dry_run && (run.done !== plan.done || run.skipped !== plan.skipped), rested = Date.now() - planned > REPLAN_MS || run.done === run.total;
    if (again || !plan || (changed && rested)) await replan();
    show();
    await files.look(run);
  }

  async function replan() {
    planned = Date.now();
    plan = await reckoned(`/runs/${id}/plan`).catch((error) => { if (!plan && error.status) return null; throw error; });
    if (!plan) return;
    Object.assign(plan, { done: run.done, skipped: run.skipped });
    for (const visit of plan.visits) for (const each of visit.readings) if (each.expected_mm) {
      if (each.id !== null) expected.set(each.id, each.expected_mm);
      expected.set(`${visit.name} ${each.target}`, each.expected_mm);
    }
    judge(); strips();
    const last = run.last_reading, now = last && plan.visits.find((visit) => visit.readings.some((each) => each.id === last.pose)), after = now && !ENDED.includes(run.state) ? now.number : null;
    const there = now && now.joints_deg.length ? await reckoned(`/cell/scene?joints_deg=${now.joints_deg.join(",")}`).catch(() => scene) : scene;
    if (there) picture.show({ ...there, path_mm: plan.path_mm, marks: marks(plan, after), described: t("runDescribed", { done: run.done, total: run.total }) });
  }

  if (id) follow(id, control, { hear, over: () => Boolean(run && ENDED.includes(run.state)), lost: () => desk.look().catch(() => {}) });
  card.addEventListener("late", () => { root.ownerDocument.getElementById("link").textContent = t("answeredAlready"); });
  addEventListener("resize", strips, { signal: control.signal });
  strips();
  return { look, show, close: () => control.abort(), shown: () => id };
}

