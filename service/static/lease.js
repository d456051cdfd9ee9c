// The motion lease: who may move the robot, and taking, giving back and taking it over.

import { ask, connection } from "./connection.js";
import { LEASE_S, desk, held, keep, looksOn, order } from "./desk.js";
import { button, h } from "./dom.js";
import { t } from "./words.js";

function said(field, otherwise) {
  const text = field.value.trim();
  if (!text) { field.focus(); throw new Error(otherwise); }
  return text;
}

// A panel with `show()`, which says it as it is now.
export function leasePanel() {
  const name = h("input", { id: "name", maxLength: 200, size: 16, autocomplete: "name" });
  const because = h("input", { id: "because", maxLength: 500, size: 24 });
  const holder = h("p", { id: "holder", role: "status" });
  const take = h("button", { id: "take" }, t("take"));
  const myself = () => ({ holder: said(name, t("sayWho")), seconds: LEASE_S });
  const give = button(t("give"), () => order(async () => { const mine = held(); keep(null); await ask("DELETE", "/cell/lease", undefined, mine); }), { id: "give" });
  const mine = h("form", { className: "row", on: { submit: (event) => {  // also Enter in the name
    event.preventDefault();
    order(async () => keep(await ask("POST", "/cell/lease", myself())));
  } } }, h("label", {}, t("yourName"), " ", name), take, give);
  const over = button(t("takeOver"), () => order(async () => {
    keep(await ask("POST", "/cell/lease/takeover", { ...myself(), reason: said(because, t("sayWhyOver")) }));
    because.value = "";
  }), { id: "over" });
  const other = h("div", { id: "other", className: "row", hidden: true }, h("label", {}, t("reason"), " ", because), over, h("span", { className: "dim" }, t("overHint")));
  const panel = h("section", { id: "lease", ariaLabel: t("lease") }, h("h2", {}, t("lease")), holder, mine, other, h("p", { className: "dim" }, t("leaseHint")));
  panel.show = () => {
    const { cell, lease } = desk;
    if (!cell) return;
    const others = cell.lease && !lease, own = lease && cell.lease && cell.lease.holder === lease.holder;
    holder.textContent = connection.silent ? t("holderSilent") : own ? t("holderYou", { name: lease.holder })
      : lease ? t("holderAsked") : others ? t("holderOther", { name: cell.lease.holder }) : t("holderNobody");
    other.hidden = !others || looksOn();
    take.disabled = Boolean(lease || others || looksOn()); give.disabled = !lease; name.disabled = Boolean(lease || looksOn());
  };
  return panel;
}
