"use strict";
const API = "/api/v1", KEPT = "truepose-token", LEASE = "truepose-lease", MOST_EVENTS = 300, LEASE_S = 15;
const $ = (id) => document.getElementById(id);
const wait = (ms) => new Promise((go) => setTimeout(go, ms));
let token = sessionStorage.getItem(KEPT) || "";
// The secret of the lease is given once: a page that is loaded again in this window goes on with the one that is kept.
let lease = JSON.parse(sessionStorage.getItem(LEASE) || "null");
let cell = null, run = null, chosen = "", stream = null, asked = "";

// -- asking the service ----------------------------------------------------------------------------------------

async function ask(method, path, body, headers = {}) {
  const sent = { Authorization: `Bearer ${token}`, ...headers };
  if (body !== undefined) sent["Content-Type"] = "application/json";
  const answer = await fetch(API + path, { method, headers: sent, body: body === undefined ? undefined : JSON.stringify(body) });
  if (answer.status === 401) { leave(); throw new Error("The token is not that of this service."); }
  const told = answer.status === 204 ? null : await answer.json();
  if (!answer.ok) throw Object.assign(new Error(`${told.operator_text} ${told.what_to_do}`), { status: answer.status });
  return told;
}

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

const looksOn = () => Boolean(cell && cell.role === "viewer");

function stop() {
  const target = cell && cell.loop_id ? `/loops/${cell.loop_id}` : cell && cell.run_id ? `/runs/${cell.run_id}` : chosen && `/runs/${chosen}`;
  if (!target) { $("trouble").textContent = "No run uses the robot."; return; }
  order(async () => {
    const told = await ask("POST", `${target}/stop`);
    if (told.problems && told.problems.length) throw new Error(told.problems.map((p) => `${p.message}. ${p.what_to_do}`).join(" "));
  });
}

// -- what is shown ---------------------------------------------------------------------------------------------

const words = (text) => text.replaceAll("_", " ");
const number = (x, digits = 3) => (typeof x === "number" ? x.toFixed(digits) : "–");
function duration(s) {
  if (s === null || s === undefined) return "";
  return s < 100 ? `${s.toFixed(0)} s left` : s < 6000 ? `${(s / 60).toFixed(0)} min left` : `${(s / 3600).toFixed(1)} h left`;
}

function showCell() {
  $("cell").textContent = `${cell.name}: ${cell.robot} and ${cell.instrument}`;
  document.title = `${run ? words(run.state) + " · " : ""}${cell.name}`;
  $("simulated").hidden = !cell.simulated;
  const other = cell.lease && !lease;
  $("viewer").hidden = !looksOn(); $("other").hidden = !other || looksOn();
  $("holder").textContent = lease ? `You hold it as ${lease.holder}.` : other ? `${cell.lease.holder} holds it.` : "Nobody holds it: nothing may begin to move.";
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
  $("left").textContent = active ? duration(run.seconds_left) : "";
  $("pause").disabled = !active;
  $("resume").disabled = !(["paused", "stopped", "ready"].includes(run.state) && lease) || run.dry_run;
  $("restation").disabled = looksOn() || run.dry_run || ["succeeded", "failed"].includes(run.state);
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

function showPrompt(prompt) {
  $("asking").hidden = !prompt;
  if (!prompt) { asked = ""; return; }
  $("question").textContent = prompt.text;
  for (const button of document.querySelectorAll("[data-answer]")) {
    button.hidden = !prompt.expects.includes(button.dataset.answer); button.disabled = looksOn();
  }
  if (asked !== prompt.id) { asked = prompt.id; $("reason").value = ""; $("asking").focus(); }
}

// -- drift and events ------------------------------------------------------------------------------------------

let first = {}, drifts = [];
function drifted(event) {
  const data = event.data;
  if (event.kind !== "reading" || data.set !== "reference" || !data.world_mm) return;
  const from = first[data.target] = first[data.target] || data.world_mm;
  drifts.push({ t: event.t_s / 60, off: Math.hypot(...data.world_mm.map((x, i) => x - from[i])), target: data.target });
}

function drawDrift() {
  const svg = $("drift"), W = svg.clientWidth || 480, H = 176, L = 66, B = 26, T = 12;
  const made = (name, values, text) => {
    const node = document.createElementNS("http://www.w3.org/2000/svg", name);
    for (const [k, v] of Object.entries(values)) node.setAttribute(k, v);
    if (text) node.textContent = text;
    return node;
  };
  const label = (x, y, anchor, text, fill = "#5a6675") => made("text", { x, y, "text-anchor": anchor, fill }, text);
  svg.setAttribute("viewBox", `0 0 ${W} ${H}`);
  const most = Math.max(0.01, ...drifts.map((d) => d.off)) * 1.1;
  const t0 = drifts.length ? drifts[0].t : 0, t1 = Math.max(t0 + 1, ...drifts.map((d) => d.t));
  const x = (t) => L + (W - L - 8) * (t - t0) / (t1 - t0), y = (off) => H - B - (H - B - T) * off / most;
  const parts = [
    made("path", { d: `M${L} ${T}V${H - B}H${W - 8}`, fill: "none", stroke: "#8d97a5" }),
    label(L - 6, T + 4, "end", `${number(most)} mm`), label(L - 6, H - B, "end", "0 mm"),
    label(L, H - 8, "start", `${number(t0, 0)} min`), label(W - 8, H - 8, "end", `${number(t1, 0)} min`),
  ];
  const colours = ["#1f6fd0", "#b3541e", "#17633a", "#7a3f98"];
  Object.keys(first).forEach((target, i) => {
    const own = drifts.filter((d) => d.target === target), stroke = colours[i % colours.length];
    parts.push(made("polyline", { points: own.map((d) => `${x(d.t).toFixed(1)},${y(d.off).toFixed(1)}`).join(" "), fill: "none", stroke, "stroke-width": 2 }));
    parts.push(...own.map((d) => made("circle", { cx: x(d.t), cy: y(d.off), r: 2.5, fill: stroke })));
    parts.push(label(L + 10 + 34 * i, T + 4, "start", target, stroke));
  });
  svg.replaceChildren(...parts);
}

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
      const headers = { Authorization: `Bearer ${token}`, ...(seen ? { "Last-Event-ID": seen } : {}) };
      const answer = await fetch(`${API}/runs/${id}/events`, { headers, signal: control.signal });
      if (!answer.ok) break;
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
    await wait(1000);
  }
  turn(); clearInterval(ticking);
}

// -- keeping up ------------------------------------------------------------------------------------------------

function choose(id) {
  if (id === chosen) return;
  chosen = id; run = null; first = {}; drifts = [];
  $("events").replaceChildren(); drawDrift();
  if (stream) stream.abort();
  stream = new AbortController();
  follow(id, stream);
}

async function refresh() {
  cell = await ask("GET", "/cell");
  if (chosen) run = await ask("GET", `/runs/${chosen}`);
  $("step").textContent = cell.loop_id ? `Loop: ${(await ask("GET", `/loops/${cell.loop_id}`)).step}` : "";
  showCell(); showRun();
}

async function list() {
  const { runs } = await ask("GET", "/runs");
  const shown = runs.map((each) => `${each.id} ${each.state}`).join();
  if ($("runs").dataset.shown !== shown) {
    $("runs").dataset.shown = shown;
    $("runs").replaceChildren(...runs.map((each) => new Option(`${each.name} · ${each.id.slice(0, 15)} · ${words(each.state)}`, each.id)));
  }
  const busy = cell && cell.run_id;
  if (busy && busy !== keepUp.busy) choose(busy);  // a run that has just begun is shown
  else if (!chosen && runs.length) choose(runs[0].id);
  keepUp.busy = busy;
  if (chosen) $("runs").value = chosen;
}

async function keepUp() {
  while (token) {
    try { await refresh(); await list(); if (chosen && !run) await refresh(); $("link").textContent = ""; }
    catch (error) { $("link").textContent = error instanceof TypeError ? "No answer from the service." : token ? error.message : ""; }
    await wait(2000);
  }
}

async function beat() {
  for (; ; await wait(LEASE_S * 1000 / 3)) {
    const mine = lease;
    if (!mine || !token) continue;
    try { await ask("POST", "/cell/lease", { holder: mine.holder, seconds: LEASE_S }, held()); }
    catch (error) {
      if (lease !== mine) continue;  // given back meanwhile
      if (error.status === 409) { keep(null); await refresh().catch(() => {}); }  // it has ended, or somebody took it over
      $("trouble").textContent = error.message;
    }
  }
}

function enter() { $("door").hidden = Boolean(token); $("desk").hidden = !token; if (token) keepUp(); else $("token").focus(); }
function leave() { token = ""; keep(null); sessionStorage.removeItem(KEPT); if (stream) stream.abort(); chosen = ""; enter(); }

$("door").addEventListener("submit", (event) => {
  event.preventDefault();
  token = $("token").value.trim(); $("token").value = "";
  order(async () => { await ask("GET", "/cell"); sessionStorage.setItem(KEPT, token); enter(); });
});
$("stop").addEventListener("click", stop);
document.addEventListener("keydown", (event) => { if (event.key === "Escape") { event.preventDefault(); stop(); } });
$("runs").addEventListener("change", () => { choose($("runs").value); order(async () => {}); });
$("pause").addEventListener("click", () => order(() => ask("POST", `${subject()}/pause`)));
$("resume").addEventListener("click", () => order(() => ask("POST", `${subject()}/resume`, undefined, { ...held(), ...key() })));
$("restation").addEventListener("click", () => order(() => ask("POST", `/runs/${chosen}/restation`, { reason: "told on the operator page" }, { ...held(), ...key() })));
for (const button of document.querySelectorAll("[data-answer]")) button.addEventListener("click", () => order(() =>
  ask("POST", `/runs/${chosen}/prompts/${asked}/${button.dataset.answer}`, { reason: $("reason").value }, { ...held(), ...key() })));
function said(id, otherwise) {
  const text = $(id).value.trim();
  if (!text) { $(id).focus(); throw new Error(otherwise); }
  return text;
}
const myself = () => ({ holder: said("name", "Say who you are first."), seconds: LEASE_S });
$("take").addEventListener("click", () => order(async () => keep(await ask("POST", "/cell/lease", myself()))));
$("over").addEventListener("click", () => order(async () => {
  keep(await ask("POST", "/cell/lease/takeover", { ...myself(), reason: said("because", "Say why you take it over.") }));
  $("because").value = "";
}));
$("give").addEventListener("click", () => order(async () => { const mine = held(); keep(null); await ask("DELETE", "/cell/lease", undefined, mine); }));
enter(); beat(); drawDrift();
