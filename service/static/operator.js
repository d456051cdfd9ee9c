"use strict";
// The page itself: what is shown, what is ordered, and keeping up with both.

const LEASE = "truepose-lease", MOST_EVENTS = 300, LEASE_S = 15, ARMED_MS = 1500, NOT_ASKED = 3020;
// The secret of the lease is given once: a page that is loaded again in this window goes on with the one that is kept.
let lease = JSON.parse(sessionStorage.getItem(LEASE) || "null");
let cell = null, run = null, loop = null, chosen = "", stream = null, asked = "", armed = "";

async function order(work) {
  try { $("trouble").textContent = ""; await work(); await refresh(); }
  catch (error) { $("trouble").textContent = error.message; }
}

const held = () => (lease ? { "Lease-Id": lease.lease_id } : {});
function keep(granted) {
  lease = granted && { holder: granted.holder, lease_id: granted.lease_id };
  if (lease) sessionStorage.setItem(LEASE, JSON.stringify(lease)); else sessionStorage.removeItem(LEASE);
}
const key = () => ({ "Idempotency-Key": crypto.randomUUID ? crypto.randomUUID() : `${Date.now()}-${Math.random()}` });
// What an order concerns: the loop that has the robot, else the run that is shown.
const subject = () => (cell && cell.loop_id && (!run || run.id.startsWith(cell.loop_id)) ? `/loops/${cell.loop_id}` : `/runs/${chosen}`);

// The serial number of another robot or instrument than that of the record, which has kept the run from going on.
function another() {
  const why = subject().startsWith("/loops/") ? loop && loop.problem : run && run.error;
  return run && run.state === "paused" && why && why.name === "OtherIndividual" ? why.serial : "";
}

const looksOn = () => Boolean(cell && cell.role === "viewer");

function stop() {
  const target = cell && cell.loop_id ? `/loops/${cell.loop_id}` : cell && cell.run_id ? `/runs/${cell.run_id}` : chosen && `/runs/${chosen}`;
  if (!target) { $("trouble").textContent = cell ? "No run uses the robot." : "This page does not know yet which run uses the robot."; return; }
  order(async () => {
    const told = await stopBy(`${target}/stop`);
    if (told.problems && told.problems.length) throw new Error(told.problems.map((p) => `${p.message}. ${p.what_to_do}`).join(" "));
  });
}

// -- what is shown ---------------------------------------------------------------------------------------------

const words = (text) => text.replaceAll("_", " ");
const number = (x, digits = 3) => (typeof x === "number" ? x.toFixed(digits) : "–");
// A forecast counts down while a person is waited for, and is 0 or missing before there is one: then it is not shown.
function timeLeft(of, now = new Date()) {
  if (of.state === "waiting_for_operator") return looksOn() ? "waiting for the operator" : "waiting for you";
  if (of.state !== "running") return "";
  const s = of.seconds_left;
  if (!s) return of.total && of.done >= of.total ? "all readings are done" : "time left: being reckoned";
  const left = s < 100 ? `${Math.ceil(s)} s` : s < 6000 ? `${(s / 60).toFixed(0)} min` : `${(s / 3600).toFixed(1)} h`;
  const end = new Date(now.getTime() + s * 1000);
  const day = end.toDateString() === now.toDateString() ? "" : `${end.toLocaleDateString("en", { weekday: "short" })} `;
  return `${left} left, done at ${day}${clock(end, 5)}`;
}

function showCell() {
  $("cell").textContent = `${cell.name}: ${cell.robot} and ${cell.instrument}`;
  document.title = `${silent ? "NO CONNECTION · " : run ? words(run.state) + " · " : ""}${cell.name}`;
  $("simulated").hidden = !cell.simulated;
  const other = cell.lease && !lease, mine = lease && cell.lease && cell.lease.holder === lease.holder;
  $("viewer").hidden = !looksOn(); $("other").hidden = !other || looksOn();
  $("holder").textContent = silent ? "Nobody knows who holds it: no connection." : mine ? `You hold it as ${lease.holder}.` : lease ? "It is being asked whether you still hold it." : other ? `${cell.lease.holder} holds it.` : "Nobody holds it: nothing may begin to move.";
  $("take").disabled = Boolean(lease || other || looksOn()); $("give").disabled = !lease; $("name").disabled = Boolean(lease || looksOn());
}

function showRun() {
  if (!run) return;
  const active = ["running", "waiting_for_operator"].includes(run.state);
  $("state").textContent = words(run.state) + (run.dry_run ? " (dry run)" : "");
  $("state").dataset.state = run.state;
  $("why").textContent = run.prompt ? "" : run.reason;
  $("bar").max = Math.max(run.total, 1); $("bar").value = run.done;
  $("done").textContent = `${run.done} of ${run.total} readings${run.skipped ? `, ${run.skipped} skipped` : ""}`;
  $("left").textContent = silent ? "" : timeLeft(run);
  $("pause").disabled = silent || !active;
  $("resume").disabled = silent || !(["paused", "stopped", "ready"].includes(run.state) && lease) || run.dry_run;
  $("restation").disabled = silent || looksOn() || run.dry_run || ["succeeded", "failed"].includes(run.state);
  $("individual").hidden = !another() || looksOn(); $("accept").disabled = !lease;
  showReading(run.last_reading);
  $("off").textContent = run.drift ? `${number(run.drift.off_mm)} mm now, ${number(run.drift.most_mm)} mm at most, ${run.drift.readings} readings` : "No second reading yet.";
  showPrompt(run.prompt);
}

function showReading(data) {
  const rows = !data ? [] : [
    ["pose", data.name], ["set", data.set], ["target", data.target],
    ...(data.world_mm || []).map((x, i) => [`world ${"xyz"[i]}, mm`, number(x)]),
    ...(typeof data.length_mm === "number" ? [["length, mm", number(data.length_mm, 4)]] : []),
    ["air, °C", number(data.t_air_c, 2)],
  ];
  $("reading").replaceChildren(...rows.map((cells) => {
    const row = document.createElement("tr");
    row.replaceChildren(...cells.map((text) => Object.assign(document.createElement("td"), { textContent: text })));
    return row;
  }));
}

// The buttons take no answer before the question can have been read: a click may have been meant for the one before.
function showPrompt(prompt) {
  $("asking").hidden = !prompt;
  if (!prompt) { asked = armed = ""; return; }
  const fresh = asked !== prompt.id;
  if (fresh) {
    asked = prompt.id; armed = ""; $("reason").value = ""; $("question").textContent = prompt.text;
    $("picture").hidden = !prompt.picture;  // as an image no text of it runs or loads anything
    if (prompt.picture) $("picture").src = "data:image/svg+xml," + encodeURIComponent(prompt.picture);
    setTimeout(() => { if (asked === prompt.id) { armed = asked; showRun(); } }, ARMED_MS);
  }
  $("arming").textContent = looksOn() ? "The operator answers." : armed ? "" : "The buttons work in a moment.";
  for (const button of document.querySelectorAll("[data-answer]")) {
    button.hidden = !prompt.expects.includes(button.dataset.answer); button.disabled = silent || looksOn();
    button.setAttribute("aria-disabled", String(!armed));
  }
  if (fresh) $("asking").focus();
}

async function answer(verb) {
  const id = armed;
  if (!id) return;  // not armed yet, or answered: a second click is no second answer
  armed = ""; showRun();
  try { await ask("POST", `/runs/${chosen}/prompts/${id}/${verb}`, { reason: $("reason").value }, { ...held(), ...key() }); }
  catch (error) {
    const late = error.code === NOT_ASKED;
    if (late && verb !== "abort") { $("link").textContent = "It was answered already."; return; }
    if (!late && asked === id) armed = id;
    throw error;
  }
}

// -- events ---------------------------------------------------------------------------------------------------

function summary(event) {
  const d = event.data;
  switch (event.kind) {
    case "state": return words(d.state) + (d.reason ? `: ${d.reason}` : "");
    case "reading": return `${d.name}, ${d.target}` + (d.world_mm ? `: ${d.world_mm.map((x) => number(x)).join(", ")} mm` : "")
      + (typeof d.length_mm === "number" ? ` to ${d.base_target}: ${number(d.length_mm, 4)} mm` : "");
    case "command": return `${d.verb} by ${d.by || "somebody"}`;
    case "prompt": return d.text;
    case "answer": return `${d.answer} by ${d.by}${d.reason ? `: ${d.reason}` : ""}`;
    case "attempt_failed": case "reconnect": return d.error ? d.error.message : "";
    default: return d.reason || d.message || (d.off_mm !== undefined ? `${number(d.off_mm)} mm` : "");
  }
}

function showEvents(events) {
  const lines = events.slice(-MOST_EVENTS).map((event) => {
    const line = document.createElement("li");
    const cells = [new Date(event.utc).toTimeString().slice(0, 8), words(event.kind), summary(event)];
    line.replaceChildren(...cells.map((text) => Object.assign(document.createElement("span"), { textContent: text })));
    return line;
  });
  $("events").prepend(...lines.reverse());
  while ($("events").childElementCount > MOST_EVENTS) $("events").lastElementChild.remove();
}

// Server-sent events by fetch: an EventSource cannot send a token.
async function follow(id, control) {
  let seen = "", text = "", fresh = [];
  const turn = () => {
    if (!fresh.length || control.signal.aborted) return;
    fresh.forEach(drifted); showEvents(fresh); drawDrift(); fresh = [];
    refresh().catch(() => {});
  };
  const ticking = setInterval(turn, 400);
  control.signal.addEventListener("abort", () => clearInterval(ticking));
  while (!control.signal.aborted) {
    try {
      const headers = { ...bearer(), ...(seen ? { "Last-Event-ID": seen } : {}) };
      const answer = await fetch(`${API}/runs/${id}/events`, { headers, signal: control.signal });
      if (answer.status >= 400 && answer.status < 500) break;
      const reader = answer.body.pipeThrough(new TextDecoderStream()).getReader();
      for (text = ""; ;) {
        const { value, done } = await reader.read();
        if (done) break;
        const blocks = (text + value.replaceAll("\r\n", "\n")).split("\n\n");
        text = blocks.pop();
        for (const block of blocks) {
          const lines = block.split("\n"), data = lines.filter((l) => l.startsWith("data:")).map((l) => l.slice(5)).join("\n");
          if (!data) continue;
          fresh.push(JSON.parse(data)); seen = String(fresh.at(-1).id);
        }
      }
      if (run && run.id === id && ["succeeded", "failed"].includes(run.state)) break;
    } catch (error) { if (control.signal.aborted) return; }
    look();  // the service may be gone
    await wait(1000);
  }
  turn(); clearInterval(ticking);
}

// -- keeping up ------------------------------------------------------------------------------------------------

// The run that is shown is the page's address: a link leads to it, and the browser's back to the one before.
const addressed = () => location.hash.slice(1);
function choose(id) {
  if (id === chosen) return;
  if (id !== addressed()) history[chosen ? "pushState" : "replaceState"](null, "", `#${id}`);
  chosen = $("runs").value = id; run = given = null; showGiven(); first = {}; drifts = [];
  $("events").replaceChildren(); drawDrift();
  if (stream) stream.abort();
  stream = new AbortController();
  follow(id, stream);
}

async function refresh() {
  cell = await ask("GET", "/cell");
  if (chosen) run = await ask("GET", `/runs/${chosen}`);
  loop = cell.loop_id ? await ask("GET", `/loops/${cell.loop_id}`) : null;
  $("step").textContent = loop ? `Loop: ${loop.step}` : "";
  showCell(); showRun();
}

async function list() {
  const { runs } = await ask("GET", "/runs");
  const shown = runs.map((each) => `${each.id} ${each.state}`).join();
  if ($("runs").dataset.shown !== shown) {
    $("runs").dataset.shown = shown;
    $("runs").replaceChildren(...runs.map((each) => new Option(`${each.name} · ${each.id.slice(0, 15)} · ${words(each.state)}`, each.id)));
  }
  const busy = cell && cell.run_id, linked = !chosen && runs.find((each) => each.id === addressed());
  if (linked) choose(linked.id);
  else if (busy && busy !== keepUp.busy) choose(busy);  // a run that has just begun is shown
  else if (!chosen && runs.length) choose(runs[0].id);
  keepUp.busy = busy;
  if (chosen) $("runs").value = chosen;
}

let awake = () => {};
const look = () => awake();  // now, rather than at the next beat

async function keepUp() {
  while (token) {
    const pause = new Promise((go) => { awake = go; });
    try { await refresh(); await list(); if (chosen && !run) await refresh(); await collect(); $("link").textContent = ""; }
    catch (error) { $("link").textContent = error instanceof Silence || !token ? "" : error.message; }
    await Promise.race([pause, wait(2000)]);
  }
}

async function prolong() {
  const mine = lease;
  if (!mine || !token) return;
  try { await ask("POST", "/cell/lease", { holder: mine.holder, seconds: LEASE_S }, held()); }
  catch (error) {
    if (lease !== mine || error instanceof Silence) return;  // given back meanwhile; or the page says it already
    if (error.status === 409) { keep(null); await refresh().catch(() => {}); }  // it has ended, or somebody took it over
    $("trouble").textContent = error.message;
  }
}

async function beat() { for (; ; await wait(LEASE_S * 1000 / 3)) await prolong(); }

function enter() { $("door").hidden = Boolean(token); $("desk").hidden = !token; if (token) keepUp(); else $("token").focus(); }
function leave() { token = ""; keep(null); sessionStorage.removeItem(KEPT); if (stream) stream.abort(); cell = run = loop = given = null; chosen = ""; showGiven(); enter(); }

$("door").addEventListener("submit", (event) => {
  event.preventDefault();
  token = $("token").value.trim(); $("token").value = "";
  order(async () => { await ask("GET", "/cell"); sessionStorage.setItem(KEPT, token); enter(); });
});
$("stop").addEventListener("click", stop);
addEventListener("popstate", () => {
  const known = [...$("runs").options].some((option) => option.value === addressed());
  if (known) { choose(addressed()); look(); } else if (chosen) history.replaceState(null, "", `#${chosen}`);
});
addEventListener("resize", drawDrift);
addEventListener("offline", look);
document.addEventListener("visibilitychange", look);  // a window that slept shows the past
document.addEventListener("keydown", (event) => {
  if (event.key === "Escape") { event.preventDefault(); if (!event.repeat) stop(); }
  else if (event.repeat && event.target.closest("button")) event.preventDefault();  // a key held down presses once
});
$("runs").addEventListener("change", () => { choose($("runs").value); order(async () => {}); });
$("pause").addEventListener("click", () => order(() => ask("POST", `${subject()}/pause`)));
const resume = (body) => ask("POST", `${subject()}/resume`, body, { ...held(), ...key() });
$("resume").addEventListener("click", () => order(() => resume()));
$("restation").addEventListener("click", () => order(() => ask("POST", `/runs/${chosen}/restation`, { reason: "told on the operator page" }, { ...held(), ...key() })));
for (const button of document.querySelectorAll("[data-answer]")) button.addEventListener("click", () => order(() => answer(button.dataset.answer)));
function said(id, otherwise) {
  const text = $(id).value.trim();
  if (!text) { $(id).focus(); throw new Error(otherwise); }
  return text;
}
const myself = () => ({ holder: said("name", "Say who you are first."), seconds: LEASE_S });
$("mine").addEventListener("submit", (event) => { event.preventDefault(); take(); });  // also Enter in the name
const take = () => order(async () => keep(await ask("POST", "/cell/lease", myself())));
$("over").addEventListener("click", () => order(async () => {
  keep(await ask("POST", "/cell/lease/takeover", { ...myself(), reason: said("because", "Say why you take it over.") }));
  $("because").value = "";
}));
$("accept").addEventListener("click", () => order(async () => {
  await resume({ accept_other: another(), reason: said("exchanged", "Say why it was exchanged.") });
  $("exchanged").value = "";
}));
$("give").addEventListener("click", () => order(async () => { const mine = held(); keep(null); await ask("DELETE", "/cell/lease", undefined, mine); }));
$("export").addEventListener("click", () => order(async () => { await ask("POST", `/runs/${chosen}/dataset`, {}, key()); await collect(true); }));
enter(); beat(); drawDrift();
