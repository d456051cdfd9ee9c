"use strict";
// Asking the service, and saying so at once when it does not answer: nobody may trust Stop, or what is shown, any more.

const API = "/api/v1", KEPT = "truepose-token", LOOK_MS = 4000, ORDER_MS = 60000, STOP_MS = 3000;
const $ = (id) => document.getElementById(id);
const wait = (ms) => new Promise((go) => setTimeout(go, ms));
const clock = (date, digits = 8) => date.toTimeString().slice(0, digits);
let token = sessionStorage.getItem(KEPT) || "";
let silent = false, unstopped = false, heardAt = null;

class Silence extends Error {}

// What `read` makes of an answer. Throws Silence when there is none, and what a refusal says.
async function reach(path, options, patience, read) {
  const asked = new Date();
  let answer, told;
  try {
    answer = await fetch(API + path, { ...options, signal: AbortSignal.timeout(patience) });
    told = await (answer.ok ? read(answer) : answer.json());  // what is no JSON comes from something else than the service
  } catch {
    heard(false);
    throw new Silence(`The order of ${clock(asked)} had no answer. Look at the state before you give it again.`);
  }
  heard(true);
  if (answer.status === 401) { leave(); throw new Error("The token is not that of this service."); }
  if (!answer.ok) throw Object.assign(new Error(`${told.operator_text} ${told.what_to_do}`), { status: answer.status, code: told.code });
  return told;
}

const bearer = () => ({ Authorization: `Bearer ${token}` });

function ask(method, path, body, headers = {}) {
  const sent = { ...bearer(), ...headers };
  if (body !== undefined) sent["Content-Type"] = "application/json";
  const options = { method, headers: sent, body: body === undefined ? undefined : JSON.stringify(body) };
  return reach(path, options, method === "GET" ? LOOK_MS : ORDER_MS, (answer) => (answer.status === 204 ? null : answer.json()));
}

// Whether the service answers. While it is silent nothing can be ordered but Stop, and what is shown is the past.
function heard(yes) {
  if (yes) heardAt = new Date();
  if (silent !== yes) return;
  silent = !yes;
  showSilence();
  if (yes) { prolong(); look(); }
}

function showSilence() {
  const here = document.activeElement;
  $("desk").inert = silent;
  if (silent) showSilence.focus = $("desk").contains(here) ? here : null;
  else if (showSilence.focus) { showSilence.focus.focus(); showSilence.focus = null; }
  document.body.classList.toggle("silent", silent);
  $("silence").hidden = !silent && !unstopped;
  $("alarm").textContent = silent ? "NOT stopped: no connection. Use the emergency stop" : unstopped ? "NOT stopped: no answer yet. Use the emergency stop" : "";
  $("since").textContent = silent && heardAt ? `What is grey is as it was at ${clock(heardAt)}. The page goes on by itself when the service answers.` : "";
  if (cell) { showCell(); showRun(); }
}

// Stop is not given up when its answer is late: the band is there until it comes.
async function stopBy(path) {
  const late = setTimeout(() => { unstopped = true; showSilence(); }, STOP_MS);
  try { return await ask("POST", path); }
  finally { clearTimeout(late); unstopped = false; showSilence(); }
}
