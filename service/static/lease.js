// Who is in control of the robot: the motion lease, taking it, giving it up and taking it over with a reason.

import { ask, connection } from "./connection.js";
import { LEASE_S, desk, held, keep, looksOn, order } from "./desk.js";
import { $, button, fill, h, icon } from "./dom.js";
import { t } from "./words.js";

let called = "";  // what a person has called himself in this window

export const myName = (input) => {
  called = input.value.trim() || called;
  if (!called) { input.focus(); throw new Error(t("sayWho")); }
  return called;
};
export const nameField = (id) => {
  const input = h("input", { id, maxLength: 200, autocomplete: "name", value: called, on: { input: () => { called = input.value.trim(); } } });
  return input;
};
const toggle = (open) => { $("pop").hidden = !open; $("control").setAttribute("aria-expanded", String(open)); };

export const takeControl = async (holder) => keep(await ask("POST", "/cell/lease", { holder, seconds: LEASE_S }));

// One of: silent, you, asked, other, nobody.
export function control() {
  const { cell, lease } = desk;
  return connection.silent ? "silent" : lease && cell && cell.lease && cell.lease.holder === lease.holder ? "you" : lease ? "asked" : cell && cell.lease ? "other" : "nobody";
}

export const holderWords = (who) => ({ silent: () => t("holderSilent"), you: () => t("holderYou"), asked: () => t("holderAsked"), other: () => t("holderOther", { name: desk.cell.lease.holder }), nobody: () => t("holderNobody") })[who]();

// The part of the strip that says who is in control.
export function showControl() {
  const who = control(), holder = desk.cell && desk.cell.lease ? desk.cell.lease.holder : desk.lease ? desk.lease.holder : "", box = $("control");
  box.hidden = !desk.cell;
  if (!desk.cell) return;
  box.classList.toggle("mine", who === "you");
  fill(box, [who, holder], () => [icon("user"), h("span", { className: "t" }, h("span", { className: "k" }, who === "you" || who === "asked" ? holder : t("lease")), h("span", { className: "v", id: "holder" }, holderWords(who))), h("span", { className: "brief", ariaHidden: "true" }, who === "other" ? holder : t(`brief_${who}`)), icon("chevron")]);
  if (!$("pop").hidden) panel();
}

function panel() {
  const who = control(), viewer = looksOn(), holder = desk.cell.lease ? desk.cell.lease.holder : "";
  fill($("pop"), [who, viewer, holder], () => {
    const title = h("h2", {}, holderWords(who));
    if (viewer || who === "silent") return [title, h("p", {}, viewer ? t("viewerMayNot") : "")];
    if (who === "you" || who === "asked") return [title, h("p", {}, t("leaseHint")), button(t("give"), () => order(async () => { const mine = held(); keep(null); await ask("DELETE", "/cell/lease", undefined, mine); toggle(false); $("control").focus(); }), { id: "give" })];
    const name = nameField("name");
    if (who === "nobody") return [title, h("form", { className: "stack", on: { submit: (event) => { event.preventDefault(); order(async () => { await takeControl(myName(name)); toggle(false); $("control").focus(); }); } } },
      h("label", { className: "field" }, h("span", {}, t("yourName")), name), h("button", { id: "take", className: "btn" }, t("take")))];
    const because = h("input", { id: "because", maxLength: 500, autocomplete: "off" });
    return [title, h("p", {}, t("overHint")), h("label", { className: "field" }, h("span", {}, t("yourName")), name), h("label", { className: "field" }, h("span", {}, t("reason")), because),
      button(t("takeOver", { name: holder }), () => order(async () => {
        const mine = myName(name), reason = because.value.trim();
        if (!reason) { because.focus(); throw new Error(t("sayWhyOver")); }
        keep(await ask("POST", "/cell/lease/takeover", { holder: mine, seconds: LEASE_S, reason }));
        toggle(false); $("control").focus();
      }), { id: "over", kind: "danger" })];
  });
}

export function openControl() {
  if (!desk.cell) return;
  toggle(true); panel();
  const first = $("pop").querySelector("input, button");
  if (first) first.focus();
}

export function closeControl() { const was = !$("pop").hidden; if (was) { toggle(false); $("control").focus(); } return was; }

$("control").addEventListener("click", () => { if ($("pop").hidden) openControl(); else closeControl(); });
document.addEventListener("pointerdown", (event) => { if (!$("pop").hidden && !$("pop").contains(event.target) && !$("control").contains(event.target)) toggle(false); });
