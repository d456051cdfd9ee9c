// The page: which view is shown under which address, what stands in its head, and keeping up with the service.

import * as campaigns from "./campaigns.js";
import * as cellView from "./cell.js";
import { Refusal, Silence, ask, clock, connection, enter, leave, signals } from "./connection.js";
import { LEASE_S, desk, keep, looksOn, order, prolong, refresh, stop, trouble } from "./desk.js";
import { $, fill, h, wait } from "./dom.js";
import * as report from "./report.js";
import * as result from "./result.js";
import * as robot from "./robot.js";
import * as robots from "./robots.js";
import * as run from "./run.js";
import { sign, state } from "./units.js";
import * as watch from "./watch.js";
import { t } from "./words.js";

const VIEWS = { cell: cellView, campaigns, run, result, report, robots, robot, watch }, BEAT_MS = 2000;
let view = null, at = "", awake = () => {};

// -- views ----------------------------------------------------------------------------------------------------

const addressed = () => {
  const [, name, id] = location.hash.match(/^#\/([a-z]+)(?:\/([0-9A-Za-z][0-9A-Za-z-]{0,63}))?$/) || [];  // an id leads nowhere else
  return Object.hasOwn(VIEWS, name) ? { name, id: id || "" } : { name: !desk.cell ? "robots" : desk.cell.run_id || desk.cell.loop_id ? "run" : "cell", id: "" };
};

function go(again = false) {
  if (!connection.token) return;
  const { name, id } = addressed(), here = `${name}/${id}`;
  if (here === at && !again) return;
  const before = at;
  if (view && view.close) view.close();
  at = here; view = null;
  const root = h("div", { className: "views" });
  $("desk").replaceChildren(root);
  view = VIEWS[name].open(root, id);
  if (desk.cell) view.show();  // what is known already, who holds the lease for one, waits for no answer
  for (const each of document.querySelectorAll("nav a")) each.toggleAttribute("aria-current", false);
  const link = document.querySelector(`nav a[href="#/${["robot", "watch"].includes(name) ? "robots" : name}"]`);
  if (link) link.setAttribute("aria-current", "page");
  $("where").textContent = t(`view_of_${name}`);
  if (before) { $("where").focus({ preventScroll: true }); scrollTo(0, 0); $("trouble").replaceChildren(); }
  head();
  look();
  if (connection.silent) past(root);
}

// A view opened while the service is silent: what was heard of it last, or that nothing was.
function past(root) {
  const none = h("p", { className: "big unheard" }, t("neverHeard"));
  lookAt(view).catch((error) => { if (error instanceof Silence) root.prepend(none); else failed(error); });
}

// -- the head -------------------------------------------------------------------------------------------------

function head() {
  const { cell, busy, loop } = desk, { silent } = connection;
  if (!cell) return;
  $("cell").textContent = cell.name;
  document.title = `${silent ? `${t("noConnection")} · ` : busy ? `${state(busy.state)} · ` : ""}${cell.name} · ${$("where").textContent}`;
  $("simulated").hidden = !cell.simulated;
  $("viewer").hidden = !looksOn();
  const here = busy && at === `run/${busy.id}`, asks = busy && busy.prompt;
  fill($("busy"), [busy && [busy.id, busy.state, busy.done, busy.total], loop && loop.step, Boolean(asks), here, silent], () => silent || here || !(busy || loop) ? []
    : h("a", { href: busy ? `#/run/${busy.id}` : `#/result/${loop.id}`, className: asks ? "asks" : "" },
      busy ? `${sign(busy.state)} ${asks ? t("asksYou") : state(busy.state)} · ${busy.done}/${busy.total}` : `${t("loop")}: ${loop.step}`));
}

function words() {
  for (const each of document.querySelectorAll("[data-word]")) each.textContent = t(each.dataset.word);
  for (const each of document.querySelectorAll("[data-label]")) each.setAttribute("aria-label", t(each.dataset.label));
}

function silence() {
  const { silent, unstopped, heardAt } = connection, here = document.activeElement, inside = $("desk").contains(here);
  $("desk").inert = silent;
  if (silent) silence.focus = silence.focus || (inside ? here : null);
  else if (silence.focus) { silence.focus.focus(); silence.focus = null; }
  document.body.classList.toggle("silent", silent);
  $("silence").hidden = !silent && !unstopped;
  $("alarm").textContent = silent ? t("notStopped") : unstopped ? t("notStoppedYet") : "";
  $("since").textContent = silent && heardAt ? t("asItWas", { time: clock(heardAt) }) : "";
  head();
  if (view) view.show();
}

// -- keeping up -----------------------------------------------------------------------------------------------

function look() { awake(); }  // now, rather than at the next beat

desk.look = async () => {
  await refresh();
  head();
  if (!at || !location.hash) go(!at);  // who has chosen no view is shown the run that begins
  if (view) await lookAt(view);
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
  $("door").hidden = known; $("desk").hidden = !known; $("views").hidden = !known;
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
  Object.assign(desk, { cell: null, busy: null, last: null, loop: null, draft: null });
  view = null; at = "";
  $("desk").replaceChildren(); $("busy").replaceChildren();
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
  if (event.key === "Escape") { event.preventDefault(); if (!event.repeat) stopNow(); }
  else if (event.repeat && event.target.closest("button")) event.preventDefault();  // a key held down presses once
});
words(); begin(); beat();
