// Step 3, Measure: a run as it goes on: accuracy, readings, prompts, poses in space and in charts; and what comes after it.

import { asked as limitsAsked } from "./acceptance.js";
import { chart } from "./charts.js";
import { ask, clock, connection, reckoned, save } from "./connection.js";
import { asPlanned, counted, driftsOf } from "./counted.js";
import { desk, looksOn, moving, order, reasonOf, workOf } from "./desk.js";
import { button, card, fact, fill, fold, footBar, h, head, noteBox } from "./dom.js";
import { eventList } from "./eventlist.js";
import { follow } from "./events.js";
import { control, openControl } from "./lease.js";
import { askAgain, deletion, menu } from "./menu.js";
import { legend, marks, posesOf } from "./plan.js";
import { poseCard } from "./poses.js";
import { promptCard } from "./prompt.js";
import { active, addressOf, loopOf, road, stageOf, walk } from "./road.js";
import { scenePicture } from "./scene.js";
import { duration, length, minus, moment, number, timeLeft } from "./units.js";
import { t } from "./words.js";

const ENDED = ["succeeded", "failed"], REPLAN_MS = 3000;
const COLOURS = { calibration: ["dots", "mark"], validation: ["squares", "after"], reference: ["dots", "between"], repeat: ["dots", "before"], nest: ["squares", "before"] };

// What an order concerns: the loop that has the robot, else the run that is shown.
const subject = (run) => (loopOf(run.id) && workOf(desk.cell).endsWith(loopOf(run.id)) ? workOf(desk.cell) : `/runs/${run.id}`);

// Makes the data set of a run and diagnoses it, once however many pages ask.
export async function diagnoseRun(run) {
  const data = await ask("POST", `/runs/${run.id}/dataset`, {}, { "Idempotency-Key": `page-dataset-${run.id}-${run.version}` });
  const job = await ask("POST", "/diagnoses", { dataset_id: data.id, ...limitsAsked() }, { "Idempotency-Key": `page-diagnosis-${data.id}` });
  walk({ run, job });
  return job;
}

export function open(root, id, step = 3) {
  if (!id) return between(root);
  const title = h("h1", { id: "title", ariaLive: "polite" }, t("view_of_measure")), box = h("div", { id: "why" }), foot = footBar(t("next")), meter = h("progress", { id: "bar", max: 1, value: 0, ariaLabel: t("readingsDone") }), tiles = h("dl", { className: "facts two" });
  const pause = () => button(t("pause"), () => order(() => ask("POST", `${subject(run)}/pause`)), { id: "pause", kind: "primary-wait", ic: "pause" });
  const goOn = (body) => ask("POST", `${subject(run)}/resume`, body, moving());
  const exchanged = h("input", { id: "exchanged", maxLength: 500 }), individual = h("div", { id: "individual", className: "card", hidden: true }, h("label", { className: "field" }, h("span", {}, t("reason")), exchanged), h("p", { className: "sub" }, t("acceptHint")));
  const accept = () => order(async () => {
    const reason = exchanged.value.trim();
    if (!reason) { exchanged.focus(); throw new Error(t("sayWhyExchanged")); }
    await goOn({ accept_other: another(), reason });
    exchanged.value = "";
  });
  const prompt = promptCard(() => run && endRun("abort")), list = eventList(), picture = scenePicture(t("runPicture"), pick), poses = poseCard(() => run, () => look(true), pick);
  const errors = chart(t("errors"), { pick, height: 220, className: "errors" }), drift = chart(t("drift"), { height: 190 }), curve = chart(t("accuracyCurve"), { height: 200 }), live = h("div", { className: "live-of" }), accuracy = h("section", { className: "card", id: "accuracy", hidden: true }, h("h2", {}, t("accuracySoFar")), h("div", { className: "live-row" }, live, curve)), off = h("p", { id: "off", className: "sub" });
  const reading = h("div", { id: "reading" });
  const restation = () => ask("POST", `/runs/${run.id}/restation`, { reason: "told on the operator page" }, moving());
  const options = menu(() => run && [
    !run.dry_run && !looksOn() && !ENDED.includes(run.state) && { text: t("restation"), id: "restation", act: () => order(restation) },
    { text: t("saveRecord"), id: "save-record", act: () => order(() => save(`/runs/${id}/events.jsonl`, `${id}-events.jsonl`)) },
    !looksOn() && run.prompt && run.prompt.expects.includes("abort") && { text: t("answer_abort"), bad: true, act: () => endRun("abort") },
    (ENDED.includes(run.state) || run.state === "stopped" || run.state === "paused") && deletion(`/runs/${id}`, run.name || id, "#/robots"),
  ].filter(Boolean) || []);
  const desks = h("div", { id: "run", className: "stack", hidden: true, "data-run": id }, prompt,
    h("div", { className: "cols c8-4 lead-row" }, accuracy, h("section", { className: "card" }, meter, h("p", { className: "sub" }, h("span", { id: "done" }), " ", h("span", { id: "left" })), tiles)),
    h("div", { className: "cols c7-5" }, h("section", { className: "card picture" }, h("h2", {}, t("runPicture")), picture, legend()), h("div", { className: "stack" }, card(t("errors"), errors, h("p", { className: "sub" }, t("errorsHint"))), poses)),
    fold(t("drift"), "", drift, off), fold(t("lastReading"), "", reading), fold(t("events"), t("newestFirst"), list));
  root.append(head(t("stepOf", { n: step }), title, null, options), box, individual, desks, foot);

  let run = null, plan = null, scene = null, planned = 0, drifts = {}, offs = {}, expected = new Map(), told = [], chosen = null, shape = null, diagnosing = false, watched = false, outcome = null;
  const control_ = new AbortController();

  // Chosen in the picture, in a chart or in the list: shown in all three.
  function pick(number) {
    chosen = chosen === number ? null : number;
    poses.choose(chosen);
    charts(); paint().catch((error) => { if (error.status === undefined) throw error; });
  }

  function endRun(verb) {
    askAgain({ title: t("endTitle"), body: t("endBody"), keep: t("keepRun"), verb: t("endVerb"), because: t("sayWhyEnded"), act: (reason) => prompt.answer(verb, reason) });
  }

  // Ends the run with the readings that it has; what follows comes by itself, here or in the loop.
  function finishEarly() {
    const { loop } = desk, inLoop = subject(run).startsWith("/loops/"), now = { n: run.done, total: run.total };
    askAgain({ title: t("finishTitle"), body: `${t(["running", "waiting_for_operator"].includes(run.state) ? "finishBody" : "finishBodyRests", now)} ${inLoop ? t(loop && loop.outlook ? "finishLoopAsks" : "finishLoopMoves") : ""}`.trim(), keep: t(["running", "waiting_for_operator"].includes(run.state) ? "keepMeasuring" : "keepRun"), verb: t("finishNow"), kind: "primary",
      act: async (reason) => { watched = true; await ask("POST", `/runs/${run.id}/finish`, { reason }, moving()); } });
  }

  // The serial number of another robot or instrument than that of the record, which has kept the run from going on.
  function another() {
    const of = subject(run).startsWith("/runs/") ? run.error : desk.loop && desk.loop.problem;
    return run.state === "paused" && of && of.name === "OtherIndividual" ? of.serial : "";
  }

  function hear(events) {
    told.push(...events.filter((each) => ["reading", "measure_again"].includes(each.kind)));
    list.add(events); judge(); charts();
    desk.look().catch(() => {});  // the band says it
  }

  // Readings against what the nominal robot predicts; a plan that came later, or has changed, judges them all anew.
  function judge() {
    const readings = counted(told);
    offs = {}; drifts = driftsOf(readings);
    for (const { data, utc } of readings) {
      const where = expected.get(data.pose) || expected.get(`${data.name} ${data.target}`), visit = plan && plan.visits.find((each) => each.name === data.name);
      if (where) (offs[data.set] = offs[data.set] || []).push({ utc, y: length(minus(asPlanned(data), where)), id: visit ? visit.number : undefined, what: `${data.name}, ${data.target}` });
    }
  }

  const seconds = (utc) => new Date(utc).getTime() / 1000, hours = (u, splits) => splits.map((each) => clock(new Date(1000 * each), 5));
  function charts() {
    const noise = plan && plan.noise_mm, n = Object.values(offs).flat().length;
    errors.set({ x: { time: hours }, y: { from: 0 }, chosen: chosen ?? undefined, says: t("errorsDescribed", { n }),
      series: Object.entries(offs).map(([set, all]) => ({ name: t(`set_${set}`), kind: (COLOURS[set] || COLOURS.repeat)[0], colour: (COLOURS[set] || COLOURS.repeat)[1], points: all.map((p) => ({ x: seconds(p.utc), y: p.y, id: p.id, tip: `${p.what}: ${number(p.y)} mm` })) })) });
    drift.set({ x: { time: hours }, y: { from: 0 }, says: t("driftDescribed"), limit: noise ? { y: noise, words: t("noiseLimit", { mm: number(noise) }) } : null,
      series: Object.entries(drifts).map(([target, all], i) => ({ name: target, colour: ["mark", "between", "after", "before"][i % 4], points: all.map((p) => ({ x: seconds(p.utc), y: p.y, tip: `${target}: ${number(p.y)} mm` })) })) });
  }

  // The accuracy so far. The predicted error alone never says that it is reached: what the diagnosis of the readings so far says stands beside it.
  function showAccuracy() {
    const a = run.accuracy;
    accuracy.hidden = !a;
    if (!a) return;
    fill(live, a, () => [h("p", { className: "live" }, a.bound_mm === null || a.bound_mm === undefined ? "–" : number(a.bound_mm, 3), h("small", {}, " mm")), h("p", { className: "sub" }, a.bound_mm ? t("boundOf", { n: a.poses, mm: number(a.wanted_mm, 2) }) : t("tooFew")),
      h("p", { id: "interim" }, h("strong", {}, `${t("interim")} `), a.verdict ? t(`verdict_${a.verdict}`) : t("notYet")), a.rms_mm ? h("p", { className: "sub" }, t("rmsSoFar", { mm: number(a.rms_mm) })) : null]);
    const point = (key) => (a.history || []).filter((each) => typeof each[key] === "number").map((each) => ({ x: each.poses, y: each[key], tip: t("atPoses", { n: each.poses, mm: number(each[key]) }) }));
    curve.set({ x: { from: 0 }, y: { from: 0 }, says: t("accuracyDescribed", { mm: number(a.bound_mm), n: a.poses }), limit: { y: a.wanted_mm, words: t("wantedLimit", { mm: number(a.wanted_mm, 2) }) }, series: [{ name: t("boundSeries"), colour: "after", points: point("bound_mm") }, { name: t("rmsSeries"), kind: "dots", colour: "before", points: point("rms_mm") }] });
  }

  function show() {
    if (!run) return;
    const looking = looksOn(), { silent } = connection, by = control(), going = ["running", "waiting_for_operator"].includes(run.state), a = run.accuracy;
    const says = run.dry_run ? t("dryRunShort") : run.state === "running" && run.done >= run.total && run.total ? t(a ? !a.ended ? "choosing" : "allDone" : road.wish ? "choosing" : "allDone") : run.finished_early ? t("finishedEarly") : t(`title_${run.state}`);
    if (title.textContent !== says) title.textContent = says;
    title.dataset.state = run.state;
    fill(box, [run.prompt ? "" : run.reason, run.error, run.state, a && [a.reached, a.reason], diagnosing, outcome && outcome.id, outcome && outcome.state], () => {
      if (run.prompt) return [];
      if (diagnosing || (outcome && active(outcome))) return noteBox("info", "info", t("diagnosingNow"), h("p", {}, t("nothingMoves")));
      const reason = run.reason ? h("p", {}, reasonOf(run, desk.cell)) : null;
      if (run.state === "stopped") return noteBox("stop", "stop", t("stoppedNow", { n: run.done }), reason, h("p", {}, t("lookInto")));
      if (run.state === "failed") return noteBox("stop", "alert", t("title_failed"), reason);
      if (run.state === "paused") return noteBox("ask", run.error ? "alert" : "pause", t("pausedNow", { n: run.done }), reason);
      if (run.finished_early) return noteBox("info", "info", t("finishedEarlyNow", { by: run.finished_early.by, n: run.finished_early.measured, total: run.finished_early.total }), run.finished_early.reason ? h("p", {}, run.finished_early.reason) : null);
      if (a && a.reached) return noteBox("good", "target", t("reachedNow", { mm: number(a.bound_mm), required: number(a.wanted_mm, 2) }), h("p", {}, a.verdict ? `${t("interim")} ${t(`verdict_${a.verdict}`)}. ` : "", a.reason || ""));
      return a && a.reason ? noteBox("info", "info", a.reason) : [];
    });
    const posed = plan ? posesOf(plan) : [], visited = posed.filter((visits) => visits.some((visit) => visit.readings.some((each) => each.status === "measured"))).length;
    meter.max = Math.max(run.total, 1); meter.value = run.done;
    const doneWords = t("doneOf", { done: run.done, total: run.total }) + (run.skipped ? `, ${t("skippedOf", { n: run.skipped })}` : ""), leftWords = silent ? "" : run.dry_run && run.seconds_left ? t("wouldTake", { time: duration(run.seconds_left) }) : ["", warming(), timeLeft(run, looking)].filter((each, i) => !i || each).join(" · ");
    if (root.querySelector("#done").textContent !== doneWords) root.querySelector("#done").textContent = doneWords;
    if (root.querySelector("#left").textContent !== leftWords) root.querySelector("#left").textContent = leftWords;
    const last = run.last_reading, by_ = last && residual(last);
    fill(tiles, [run.done, run.total, visited, posed.length, run.seconds_left, by_, last && last.pose, run.drift, a && [a.poses, a.poses_left, a.minutes_left]], () => [fact(t("readings"), [String(run.done), h("small", {}, ` / ${run.total}`)]), fact(t("poses"), posed.length ? [String(visited), h("small", {}, ` / ${posed.length}`)] : "–", a && typeof a.poses_left === "number" ? t("posesLeft", { n: a.poses_left }) : null),
      fact(t("lastReading"), by_ ? [number(length(by_), 2), h("small", {}, " mm")] : "–", last ? t("offAt", { name: last.name, target: last.target }) : null), fact(t("driftShort"), run.drift ? [number(run.drift.off_mm), h("small", {}, " mm")] : "–", a && typeof a.minutes_left === "number" ? t("minutesLeft", { n: Math.round(a.minutes_left) }) : t("ofReference"))]);
    off.textContent = run.drift ? t("driftNow", { now: number(run.drift.off_mm), most: number(run.drift.most_mm), n: run.drift.readings }) : t("driftNone");
    individual.hidden = !another() || looking;
    showReading(last); showAccuracy(); options.show();
    prompt.show(run, scene); poses.show(plan, run);
    for (const each of [poses, list.parentElement.parentElement, options]) each.hidden = run.dry_run;
    const inLoop = loopOf(run.id), loopOn = desk.loop && desk.loop.id === inLoop, resumable = ["paused", "stopped", "ready"].includes(run.state) && !run.dry_run && (!inLoop || loopOn);
    const finish = (kind) => button(t("finishAndDiagnose"), () => order(finishNow), { id: "finish", kind, ic: "arrow" });
    const fits = run.done > 0 && !looking && (!inLoop || (loopOn && by === "you" && subject(run).startsWith("/loops/") && /-campaign(1|-follow-up)$/.test(run.id))), early = () => fits && button(t("finishNow"), finishEarly, { id: "finish-early" });
    const found = outcome && { id: outcome.id, done: outcome.state === "succeeded" };
    const state_ = silent ? "silent" : run.prompt ? "prompt" : going ? "going" : found ? "found" : run.dry_run ? "dry" : inLoop && run.state === "succeeded" ? "loop" : looking ? "looking" : another() ? "another" : resumable ? `rests ${by}` : run.state === "succeeded" ? (diagnosing ? "diagnosing" : "succeeded") : "over";
    foot.set([state_, run.state, found && found.id, looking, fits], {
      silent: t("silentFoot"), prompt: looking ? t("operatorAnswers") : t("answerAbove"), going: looking ? t("viewerFoot") : t("nothingToDo"), found: t("next_diagnose"), dry: t("next_prepare"), loop: t("loopGoesOn"), looking: t("viewerMayNot"), another: t("acceptFoot"),
      "rests you": t("resumeFoot"), "rests nobody": t("leaseFirst"), "rests other": t("otherInControl", { name: desk.cell && desk.cell.lease ? desk.cell.lease.holder : "" }), "rests asked": t("holderAsked"), succeeded: t("next_finish"), diagnosing: t("nothingMoves"), over: t("overFoot"),
    }[state_] || "", () => ({
      going: [early(), pause()], prompt: [early(), pause()], found: found ? [h("a", { className: "btn primary", id: "see-result", href: `#/diagnose/${found.id}` }, t("seeResult"))] : [], dry: [h("a", { className: "btn primary", href: "#/prepare" }, t("view_of_prepare"))], loop: [h("a", { className: "btn primary", href: `#/${step === 6 ? "verify" : "diagnose"}/${inLoop}` }, t("seeResult"))],
      another: [button(t("accept"), accept, { id: "accept", kind: "primary", ic: "play" })], "rests you": [early(), button(t("resume"), () => order(() => goOn()), { id: "resume", kind: "primary", ic: "play" })],
      "rests nobody": [early(), button(t("take"), openControl, { id: "to-control", kind: "primary", ic: "user" })], "rests other": [button(t("takeOverOf", { name: desk.cell && desk.cell.lease ? desk.cell.lease.holder : "" }), openControl, { id: "to-control", kind: "primary", ic: "user" })],
      succeeded: [finish("primary")], over: looking ? [] : [h("a", { className: "btn primary", href: "#/prepare" }, t("newCalibration"))],
    }[state_] || []).filter(Boolean));
  }

  const residual = (data) => { const where = expected.get(data.pose) || expected.get(`${data.name} ${data.target}`); return where && data.world_mm ? minus(asPlanned(data), where) : null; };

  // Until when the arm is warming up: the last word of the record about it that nothing has followed.
  function warming() {
    const until = list.warmingUntil();
    if (run.state !== "running" || !until) return "";
    return run.simulated ? t("warmingFast") : until > new Date() ? t("warming", { at: moment(until) }) : "";
  }

  function showReading(data) {
    const by = data ? residual(data) : null;
    const rows = !data ? [] : [[t("pose"), data.name], [t("set"), t(`set_${data.set}`)], [t("target"), data.target],
      ...(data.world_mm || []).map((x, i) => [t("worldMm", { axis: "xyz"[i] }), number(x) + (by ? `  (${by[i] < 0 ? "−" : "+"}${number(Math.abs(by[i]))})` : "")]),
      ...(typeof data.length_mm === "number" ? [[t("lengthTo", { base: data.base_target }), `${number(data.length_mm, 4)} mm`]] : []),
      ...(typeof data.t_air_c === "number" ? [[t("air"), `${number(data.t_air_c, 2)} °C`]] : [])];
    fill(reading, [rows, by], () => !data ? h("p", {}, t("noneYet")) : [
      by && h("p", { className: "big" }, t("residual", { mm: number(length(by)) }), h("small", {}, ` ${t("against")}`)),
      h("table", {}, h("caption", {}, t("lastReading")), h("tbody", {}, rows.map(([name, value]) => h("tr", {}, h("th", { scope: "row" }, name), h("td", { className: "n" }, value)))))]);
  }

  async function finishNow() {
    diagnosing = true; show();
    try { location.hash = `#/diagnose/${(await diagnoseRun(run)).id}`; } finally { diagnosing = false; show(); }
  }

  // What is known of a run that has ended; the data set and the diagnosis of one that was watched come without a click.
  async function afterwards() {
    if (run.dry_run || run.state !== "succeeded" || loopOf(run.id) || diagnosing || (outcome && !active(outcome))) return;
    const { datasets } = await ask("GET", "/datasets"), own = datasets.filter((each) => each.run_id === run.id);
    const jobs = (await Promise.all(own.map((each) => ask("GET", `/datasets/${each.id}/jobs`)))).flatMap((each) => each.jobs).filter((each) => ["diagnosis", "identification"].includes(each.kind));
    outcome = jobs.sort((a, b) => (a.created_utc < b.created_utc ? 1 : -1))[0] || null;
    show();
    if (!outcome && !looksOn() && (watched || (desk.last && desk.last.id === run.id)) && !afterwards.tried) { afterwards.tried = true; order(finishNow); }
  }

  // A loop goes from run to run, and to its diagnosis, by itself: who watches it goes along.
  function along() {
    const loop = desk.loop;
    if (!watched || !loop || loop.id !== loopOf(id)) return;
    const stage = stageOf(loop);
    if (stage === 5 && step !== 6) location.replace(`#/verify/${loop.id}`);
    else if (stage === 2 && loop.run_id && loop.run_id !== id) location.replace(`#/measure/${loop.run_id}`);
    else if (stage === 3 || stage === 4) location.replace(`#/diagnose/${loop.id}`);
  }

  async function look(again = false) {
    run = await ask("GET", `/runs/${id}`);
    if (!run.dry_run && step !== 6) walk({ run });  // the run of a proof is not that of the model
    if (active(run)) watched = true;
    desks.hidden = false;
    show();
    if (!scene && desk.cell) scene = await reckoned("/cell/scene").catch(() => null);
    const changed = plan && !run.dry_run && (run.done !== plan.done || run.skipped !== plan.skipped), rested = Date.now() - planned > REPLAN_MS || run.done === run.total;
    if (again || !plan || (changed && rested)) await replan();
    show(); along();
    await afterwards();
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
    judge(); charts();
    await paint();
  }

  async function paint() {
    if (!plan) return;
    const last = run.last_reading, now = last && plan.visits.find((visit) => visit.readings.some((each) => each.id === last.pose)), after = now && !ENDED.includes(run.state) ? now.number : null, at = plan.visits.find((visit) => visit.number === chosen) || now;
    if (at && at.joints_deg.length && (!shape || shape.number !== at.number)) shape = { number: at.number, scene: await reckoned(`/cell/scene?joints_deg=${at.joints_deg.join(",")}`).catch(() => scene) };
    const there = shape ? shape.scene : scene;
    if (there) picture.show({ ...there, path_mm: plan.path_mm, marks: marks(plan, after, chosen), says: chosen === null ? t("runSays") : t("stoodAt", { name: at ? at.name : "" }), described: t("runDescribed", { done: run.done, total: run.total }) });
  }

  follow(id, control_, { hear, over: () => Boolean(run && ENDED.includes(run.state)), lost: () => desk.look().catch(() => {}) });
  prompt.addEventListener("late", () => { root.ownerDocument.getElementById("link").textContent = t("answeredAlready"); });
  charts();
  return { look, show, close: () => control_.abort(), shown: () => id };
}

// Without a run: that of the loop or of the road that there is, or what to do first.
function between(root) {
  const title = h("h1", { id: "title" }, t("view_of_measure")), says = h("p", { className: "lead" }), foot = footBar(t("next"));
  root.append(head(t("stepOf", { n: 3 }), title, says), foot);
  const look = async () => {
    const { cell, loop } = desk, at = cell && cell.run_id ? cell.run_id : loop && loop.run_id ? loop.run_id : !loop && cell ? cell.last_run_id : "";
    if (at) { history.replaceState(null, "", `#/measure/${at}`); dispatchEvent(new HashChangeEvent("hashchange")); return; }
    show();
  };
  const show = () => {
    says.textContent = desk.loop ? `${t("loop")}: ${desk.loop.step}` : t("noRun");
    foot.set([Boolean(desk.loop), looksOn()], desk.loop ? t("loopGoesOn") : "", () => (desk.loop || looksOn() ? [] : [h("a", { className: "btn primary", href: addressOf(road.plan || road.wish ? "check" : "prepare") }, t(road.plan || road.wish ? "view_of_check" : "newCalibration"))]));
  };
  return { look, show };
}
