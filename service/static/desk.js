// What is known of the cell, and the orders to it: the lease, stop, and errors with what to do about them.

import { Silence, ask, connection, key, stopBy, theCell } from "./connection.js";
import { $, h } from "./dom.js";
import { t } from "./words.js";

const LEASE = "truepose-lease";
export const LEASE_S = 15;
// `busy`: the run that uses the robot; `loop`: the loop or the verification that does. `look`: look at the service now. `draft`: what has been
// typed for a prompt that is not answered yet.
export const desk = { cell: null, devices: [], busy: null, last: null, loop: null, draft: null, lease: JSON.parse(sessionStorage.getItem(LEASE) || "null"), look: async () => {} };

export const looksOn = () => Boolean(desk.cell && desk.cell.role === "viewer");
export const held = () => (desk.lease ? { "Lease-Id": desk.lease.lease_id } : {});
export const moving = () => ({ ...held(), ...key() });

// The secret of the lease is given once: a page that is loaded again in this window goes on with the one that is kept.
export function keep(granted) {
  desk.lease = granted && { holder: granted.holder, lease_id: granted.lease_id };
  if (desk.lease) sessionStorage.setItem(LEASE, JSON.stringify(desk.lease)); else sessionStorage.removeItem(LEASE);
}

// What went wrong, and what to do.
export function trouble(error) {
  const parts = !error ? [] : error.whatToDo
    ? [h("strong", {}, error.message), " ", h("span", {}, `${t("whatToDo")} `, error.whatToDo)]
    : [error.message];
  $("trouble").replaceChildren(...parts);
}

export async function order(work) {
  try { trouble(null); const done = await work(); await desk.look(); return done; }
  catch (error) { trouble(error); return undefined; }
}

export async function refresh() {
  desk.cell = await theCell();
  if (!desk.cell) return;
  const { run_id: busy, last_run_id: last } = desk.cell;
  desk.last = busy || last ? await ask("GET", `/runs/${busy || last}`).catch((error) => { if (error.status === 404) return null; throw error; }) : null;
  desk.busy = busy ? desk.last : null;
  desk.devices = (await ask("GET", "/cell/devices")).devices;
  desk.loop = workOf(desk.cell) ? await ask("GET", workOf(desk.cell)) : null;
}

// The loop or the verification that uses the robot, as a path; empty where none does.
export const workOf = (cell) => (!cell ? "" : cell.loop_id ? `/loops/${cell.loop_id}` : cell.verification_id ? `/verifications/${cell.verification_id}` : "");

// The run that used the robot last, where it is to go on: perhaps its link was lost, and the robot moves still.
export const resting = () => (!desk.busy && desk.last && ["paused", "stopped"].includes(desk.last.state) ? desk.last : null);

// Stops what uses the robot; `shown`: the run that is looked at, where nothing is known to use it.
export function stop(shown) {
  const { cell } = desk, rests = resting(), kept = shown || (rests && rests.state === "paused" && rests.id);
  const target = workOf(cell) ? workOf(cell) : cell && cell.run_id ? `/runs/${cell.run_id}` : kept && `/runs/${kept}`;
  if (!target) { trouble(new Error(cell ? t("nothingToStop") : t("nothingKnown"))); return; }
  order(async () => {
    const told = await stopBy(`${target}/stop`);
    if (told.problems && told.problems.length) throw new Error(told.problems.map((p) => `${p.what_to_do} ${p.message}.`).join(" "));
  });
}

export async function prolong() {
  const mine = desk.lease;
  if (!mine || !connection.token) return;
  try { await ask("POST", "/cell/lease", { holder: mine.holder, seconds: LEASE_S }, held()); }
  catch (error) {
    if (desk.lease !== mine || error instanceof Silence) return;  // given back meanwhile; or the page says it already
    if (error.status === 409) { keep(null); await desk.look().catch(() => {}); }  // it has ended, or somebody took it over
    trouble(error);
  }
}

// Why a run does not go on: what is to be done at once stands out, and what a device met names the device.
export function reasonOf(run, cell) {
  const [urgent] = /^Press the emergency stop[^.]*\./.exec(run.reason) || [""], rest = run.reason.slice(urgent.length).trim();
  const { device = "", message = "" } = run.error || {}, { robot_driver: robot, instrument_driver: instrument } = cell || {};
  const which = device && device === robot ? t("robot") : device && device === instrument ? t("instrument") : "";
  const told = which && rest.startsWith(`${device}: `) ? rest.slice(device.length + 2) : rest;
  return [urgent && h("strong", { className: "urgent" }, urgent), which && message && told.startsWith(message) ? `${which} (${device}): ` : "", told].filter(Boolean);
}
