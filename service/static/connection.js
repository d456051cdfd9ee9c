// Asking the service, and saying so at once when it does not answer: nobody may trust Stop, or what is shown, any more.

import { t } from "./words.js";

export const API = "/api/v1";
const KEPT = "truepose-token", LOOK_MS = 3000, ORDER_MS = 60000, STOP_MS = 1000;
export const signals = new EventTarget();  // "heard": connection.silent or .unstopped has changed; "left": no token
export const connection = { token: sessionStorage.getItem(KEPT) || "", silent: false, unstopped: false, heardAt: null };
const tell = (kind) => signals.dispatchEvent(new Event(kind));

export const clock = (date, digits = 8) => date.toTimeString().slice(0, digits);

// What was answered last, by path, newest last: a view that is opened while the service is silent shows it, in grey.
const answered = new Map(), MOST_ANSWERS = 100, PROBE = "/cell";

export class Silence extends Error {}

// A refusal of the service: what happened, and what to do.
export class Refusal extends Error {
  constructor(told, status) {
    super(told.operator_text || told.detail || String(status));
    Object.assign(this, { status, code: told.code, whatToDo: told.what_to_do || "", told });
  }
}

// What `read` makes of an answer. Throws Silence when there is none, and Refusal.
export async function reach(path, options, patience, read) {
  const asked = new Date(), mine = connection.token;
  let answer, told;
  try {
    answer = await fetch(API + path, { ...options, signal: AbortSignal.timeout(patience) });
    told = await (answer.ok ? read(answer) : answer.json());  // what is no JSON comes from something else than the service
  } catch {
    heard(false);
    throw new Silence(t("noAnswer", { time: clock(asked) }));
  }
  heard(true);
  if (answer.status === 401) {
    if (mine && mine === connection.token) leave();  // not for what was asked before somebody else came
    throw new Error(t("wrongToken"));
  }
  if (!answer.ok) throw new Refusal(told, answer.status);
  return told;
}

export const bearer = () => ({ Authorization: `Bearer ${connection.token}` });
export const key = () => ({ "Idempotency-Key": crypto.randomUUID ? crypto.randomUUID() : `${Date.now()}-${Math.random()}` });

// As `reach`, for what is looked at. While the service is silent only the probe goes on asking it.
async function lookUp(path, options, patience, read) {
  if (connection.silent && path !== PROBE && answered.has(path)) return answered.get(path);
  const told = await reach(path, options, patience, read);
  answered.delete(path); answered.set(path, told);
  if (answered.size > MOST_ANSWERS) answered.delete(answered.keys().next().value);
  return told;
}

export function ask(method, path, body, headers = {}) {
  const sent = { ...bearer(), ...headers };
  if (body !== undefined) sent["Content-Type"] = "application/json";
  const options = { method, headers: sent, body: body === undefined ? undefined : JSON.stringify(body) };
  return (method === "GET" ? lookUp : reach)(path, options, method === "GET" ? LOOK_MS : ORDER_MS, (answer) => (answer.status === 204 ? null : answer.json()));
}

// What takes the service longer than a look: a plan, a price.
export const reckoned = (path) => lookUp(path, { headers: bearer() }, ORDER_MS, (answer) => answer.json());

export function upload(path, files) {
  const form = new FormData();
  for (const [name, value] of Object.entries(files)) for (const each of [value].flat()) form.append(name, each);
  return reach(path, { method: "POST", headers: { ...bearer(), ...key() }, body: form }, ORDER_MS, (answer) => answer.json());
}

export const text = (path) => lookUp(path, { headers: bearer() }, ORDER_MS, (answer) => answer.text());

// A link cannot send a token: the file is fetched with it, and then saved.
export async function save(path, name) {
  keepFile(await reach(path, { headers: bearer() }, ORDER_MS, (answer) => answer.blob()), name);
}

export function keepFile(blob, name) {
  const url = URL.createObjectURL(blob);
  Object.assign(document.createElement("a"), { href: url, download: name }).click();
  setTimeout(() => URL.revokeObjectURL(url), 60000);
}

// Whether the service answers. While it is silent nothing can be ordered but Stop, and what is shown is the past.
function heard(yes) {
  if (yes) connection.heardAt = new Date();
  if (connection.silent !== yes) return;
  connection.silent = !yes;
  tell("heard");
}

// Stop is not given up when its answer is late: the band is there until it comes.
export async function stopBy(path) {
  const late = setTimeout(() => { connection.unstopped = true; tell("heard"); }, STOP_MS);
  try { return await ask("POST", path); }
  finally { clearTimeout(late); connection.unstopped = false; tell("heard"); }
}

// The cell of the service; null where it has none, as in an office that looks at robots.
export const theCell = () => ask("GET", PROBE).catch((error) => { if (error.status === 404) return null; throw error; });

export async function enter(token) {
  connection.token = token;
  await theCell();
  sessionStorage.setItem(KEPT, token);
}

export function leave() {
  connection.token = "";
  answered.clear();
  sessionStorage.removeItem(KEPT);
  tell("left");
}
