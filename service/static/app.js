// The page: which view is shown under which address, the strip and the rail, and keeping up with the service.

import * as check from "./check.js";
import { Refusal, Silence, ask, clock, connection, enter, leave, signals } from "./connection.js";
import * as correct from "./correct.js";
import * as data from "./data.js";
import { LEASE_S, desk, keep, looksOn, order, prolong, refresh, stop, trouble, workOf } from "./desk.js";
import * as diagnose from "./diagnose.js";
import { $, fill, h, icon, wait } from "./dom.js";
import { closeControl, showControl } from "./lease.js";
import * as measure from "./measure.js";
import { closeAll } from "./menu.js";
import * as prepare from "./prepare.js";
import * as report from "./report.js";
import { STEPS, active, afresh, loopOf, ofProof, road, showRail, walk } from "./road.js";
import * as robot from "./robot.js";
import * as robots from "./robots.js";
import { moment, sign, state } from "./units.js";
import * as verify from "./verify.js";
import * as watch from "./watch.js";
import { t } from "./words.js";

const VIEWS = { prepare, check, measure, diagnose, correct, verify, data, report, robots, robot, watch }, BEAT_MS = 2000;
const OLD = { cell: "prepare", campaigns: "check", run: "measure", result: "diagnose" };  // addresses that were sent and bookmarked
let view = null, at = "", named = "", awake = () => {};

// -- views ----------------------------------------------------------------------------------------------------

const addressed = () => {
  const [, name = "", id = ""] = location.hash.match(/^#\/([a-z]+)(?:\/([0-9A-Za-z][0-9A-Za-z-]{0,63}))?$/) || [];  // an id leads nowhere else
  if (Object.hasOwn(OLD, name)) return { name: id ? OLD[name] : { campaigns: "prepare", result: "data" }[name] || OLD[name], id };
  return Object.hasOwn(VIEWS, name) ? { name, id } : { name: !desk.cell ? "robots" : desk.cell.run_id ? "measure" : workOf(desk.cell) ? (desk.cell.loop_id ? "diagnose" : "verify") : "prepare", id: "" };
};

function go(again = false) {
  if (!connection.token) return;
  const { name, id } = addressed(), here = `${name}/${id}`;
  if (here === at && !again) return;
  const before = at;
  if (view && view.close) view.close();
  closeAll(); closeControl();
  at = here; named = name; view = null;
  const root = h("div", { className: "views" });
  $("desk").replaceChildren(root);
  view = VIEWS[name].open(root, id);
  if (desk.cell) view.show();  // what is known already, who is in control for one, waits for no answer
  const place = { robot: "robots", watch: "robots" }[name] || name;
  for (const each of document.querySelectorAll("#places a")) if (each.hash === `#/${place}`) each.setAttribute("aria-current", "page"); else each.removeAttribute("aria-current");
  frame();
  if (before) {
    const title = $("title");
    if (title) { title.tabIndex = -1; title.focus({ preventScroll: true }); }
    scrollTo(0, 0); $("trouble").replaceChildren();
  }
  look();
  if (connection.silent) past(root);
}

// A view opened while the service is silent: what was heard of it last, or that nothing was.
function past(root) {
  const none = h("p", { className: "big unheard" }, t("neverHeard"));
  lookAt(view).catch((error) => { if (error instanceof Silence) root.prepend(none); else failed(error); });
}

// -- the strip and the rail -----------------------------------------------------------------------------------

// What is known of a device: a grey dot, unless it needs a person. It is not asked for this.
const TROUBLE = { beam_lost: "warn", silent: "bad", in_error: "bad" };
function devices() {
  const { busy } = desk, { silent } = connection;
  const one = (each) => {
    const known = silent ? "unknown" : each.state, kind = known === "unknown" ? "off" : TROUBLE[known] || "", since = silent || !each.since_utc ? "" : t("sinceThen", { time: moment(new Date(each.since_utc)) });
    return h("li", { className: `dev ${kind}`, title: silent ? t("neverHeard") : each.says, "data-role": each.role, "data-state": known }, icon(kind === "off" ? "off" : kind ? "alert" : each.role === "robot" ? "robot" : "tracker"),
      h("span", { className: "t" }, h("span", { className: "k" }, t(each.role), h("span", { className: "model" }, ` ${each.name}`)), h("span", { className: "v" }, h("i", { className: "dot", "aria-hidden": "true" }), t(`dev_${known}`), since && h("span", { className: "from" }, ` ${since}`))));
  };
  const air = busy && busy.last_reading && typeof busy.last_reading.t_air_c === "number" ? busy.last_reading.t_air_c : null;
  return [...desk.devices.map(one),
    air === null ? null : h("li", { className: "dev" }, icon("air"), h("span", { className: "t" }, h("span", { className: "k" }, t("air")), h("span", { className: "v" }, `${air.toFixed(1)} °C`)))];
}

function frame() {
  const { cell, busy, loop } = desk, { silent } = connection;
  showControl();
  if (cell && !road.run && !road.job && (busy || loop) && !(busy && busy.dry_run)) walk({ run: busy, loop });
  if (loop && road.run && loopOf(road.run.id) === loop.id) road.loop = loop;
  if (busy && road.run && !ofProof(busy, loop) && (busy.id === road.run.id || (loop && loopOf(road.run.id) === loop.id))) road.run = busy;
  showRail(named);
  if (!cell) return;
  const here = STEPS.includes(named) ? t(`view_of_${named}`) : t(`view_of_${{ robot: "robots", watch: "robots" }[named] || named}`), asks = busy && busy.prompt;
  $("cell").textContent = cell.name;
  document.title = `${silent ? `${t("noConnection")} · ` : asks ? `${t("asksYou")} · ` : busy ? `${state(busy.state)} · ` : ""}${here} · ${cell.name} · TruePose`;
  $("simulated").hidden = !cell.simulated;
  $("viewer").hidden = !looksOn();
  fill($("devices"), [silent, desk.devices.map((each) => [each.role, each.name, each.state, each.says, each.since_utc]), busy && busy.last_reading && busy.last_reading.t_air_c], devices);
}

function words() {
  for (const each of document.querySelectorAll("[data-word]")) each.textContent = t(each.dataset.word);
  for (const each of document.querySelectorAll("[data-label]")) each.setAttribute("aria-label", t(each.dataset.label));
}

function silence() {
  const { silent, unstopped, heardAt } = connection, here = document.activeElement, inside = $("desk").contains(here);
  $("desk").inert = silent; $("pop").inert = silent;
  if (silent) silence.focus = silence.focus || (inside ? here : null);
  else if (silence.focus) { silence.focus.focus(); silence.focus = null; }
  document.body.classList.toggle("silent", silent);
  $("silence").hidden = !silent && !unstopped;
  $("alarm").textContent = silent ? t("notStopped") : unstopped ? t("notStoppedYet") : "";
  $("since").textContent = silent && heardAt ? t("asItWas", { time: clock(heardAt) }) : "";
  frame();
  if (view) view.show();
}

// -- keeping up -----------------------------------------------------------------------------------------------

function look() { awake(); }  // now, rather than at the next beat

desk.look = async () => {
  await refresh();
  frame();
  if (!at || !location.hash) go(!at);  // who has chosen no view is shown the run that begins
  if (view) await lookAt(view);
  frame();
};

// One look at a view at a time; who asks during one gets the next, which all share who ask meanwhile. A plan may take
// long; that the service is silent is noticed by whoever asks for the cell.
let looking = null, next = null;
function lookAt(of) {
  if (!looking || looking.of !== of) {
    const own = { of, done: of.look().finally(() => { if (looking === own) looking = null; }) };
    looking = own;
    return own.done;
  }
  next = next || looking.done.catch(() => {}).then(() => { next = null; return view && lookAt(view); });
  return next;
}

// What keeps the view from being shown; the service's silence has its band, and a fault of this page goes to the console.
function failed(error) {
  if (error instanceof Silence || !connection.token) return;
  if (!(error instanceof Refusal)) { console.error(error); $("link").textContent = error.message; return; }
  if (!$("trouble").textContent.startsWith(error.message)) trouble(error);
}

let keeper = 0;
async function keepUp() {
  const mine = keeper += 1;
  while (connection.token && mine === keeper) {
    const pause = new Promise((wake) => { awake = wake; });
    try { await Promise.race([desk.look(), wait(BEAT_MS)]); $("link").textContent = ""; }
    catch (error) { failed(error); }
    await Promise.race([pause, wait(BEAT_MS)]);
  }
}

async function beat() { for (; ; await wait(LEASE_S * 1000 / 3)) await prolong(); }

function begin() {
  const known = Boolean(connection.token);
  $("door").hidden = known;
  for (const each of ["desk", "rail", "places", "out"]) $(each).hidden = !known;
  if (known) keepUp(); else $("token").focus();
}

// Whether the service that is back is the one that this page is of. Nothing is loaded by itself: a reason may be half typed.
async function compare() {
  const health = await ask("GET", "/health").catch(() => null);
  if (health && health.page) $("old").hidden = health.page === document.documentElement.dataset.page;
}

signals.addEventListener("heard", () => {
  silence();
  if (connection.silent) return;
  document.querySelector(".unheard")?.remove();
  prolong(); look(); compare();
});
$("again").addEventListener("click", () => location.reload());
signals.addEventListener("left", () => {
  keep(null);
  if (view && view.close) view.close();
  Object.assign(desk, { cell: null, devices: [], busy: null, last: null, loop: null, draft: null });
  view = null; at = ""; afresh();
  $("desk").replaceChildren(); $("control").hidden = true; $("devices").replaceChildren();
  begin();
});
$("door").addEventListener("submit", (event) => {
  event.preventDefault();
  const token = $("token").value.trim();
  $("token").value = "";
  order(async () => { await enter(token); begin(); });
});
$("out").addEventListener("click", leave);
const stopNow = () => stop(view && view.shown ? view.shown() : "");
$("stop").addEventListener("click", stopNow);
addEventListener("hashchange", () => go());
addEventListener("offline", look);
document.addEventListener("visibilitychange", look);  // a window that slept shows the past
document.addEventListener("keydown", (event) => {
  if (event.key === "Escape") {  // it stops, whatever lies over the page; where nothing moves it only closes that
    event.preventDefault();
    const closed = [closeAll(), closeControl()].some(Boolean);
    if (!event.repeat && !(closed && !desk.busy && !desk.loop && desk.cell && !connection.silent)) stopNow();
  }
  else if (event.repeat && event.target.closest("button")) event.preventDefault();  // a key held down presses once
});
$("skip").addEventListener("click", (event) => { event.preventDefault(); $("main").focus(); });
$("stop").append(icon("stop"), h("span", { className: "long" }, t("stop")), h("span", { className: "short" }, t("stopShort")), h("kbd", {}, "Esc"));
words(); begin(); beat();
