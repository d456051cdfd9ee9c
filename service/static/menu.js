// The menu of what is rare or destroys something, and asking once more before it is done.

import { ask } from "./connection.js";
import { held, looksOn, order } from "./desk.js";
import { $, button, h, icon } from "./dom.js";
import { t } from "./words.js";

// `items()`: [{text, act, bad, id}], made when it is opened; what is destructive comes last, in red.
export function menu(items) {
  const list = h("div", { className: "menu", role: "menu", hidden: true }), open = h("button", { type: "button", className: "btn quiet square more", ariaLabel: t("moreActions"), "aria-haspopup": "menu", "aria-expanded": "false" }, icon("more"));
  const show = (yes) => { list.hidden = !yes; open.setAttribute("aria-expanded", String(yes)); };
  const whole = h("div", { className: "menu-of" }, open, list);
  open.addEventListener("click", () => {
    if (!list.hidden) { show(false); return; }
    list.replaceChildren(...items().filter(Boolean).map((each) => h("button", { type: "button", role: "menuitem", id: each.id, className: each.bad ? "bad" : "", on: { click: () => { show(false); open.focus(); each.act(); } } }, each.text)));
    show(true);
    if (list.firstChild) list.firstChild.focus();
  });
  list.addEventListener("keydown", (event) => {
    const all = [...list.children], by = { ArrowDown: 1, ArrowUp: -1 }[event.key];
    if (by) { event.preventDefault(); all[(all.indexOf(document.activeElement) + by + all.length) % all.length].focus(); }
  });
  whole.addEventListener("focusout", (event) => { if (!whole.contains(event.relatedTarget)) show(false); });
  whole.show = () => { open.hidden = !items().some(Boolean); };
  queueMicrotask(whole.show);  // its view is made then
  return whole;
}

// Closes what lies over the page; whether something did.
export function closeAll() {
  const open = [...document.querySelectorAll(".menu:not([hidden])")], dialog = $("ask"), any = open.length > 0 || dialog.open;
  for (const each of open) { each.hidden = true; each.previousSibling.setAttribute("aria-expanded", "false"); each.previousSibling.focus(); }
  if (dialog.open) dialog.close();
  return any;
}

// Asks once more. The title names the thing, the button repeats the verb, the safe answer has the focus, a reason is needed where
// `because` asks for one. It is not modal: Stop can be pressed beside it. `act(reason)`.
export function askAgain({ title, body, keep, verb, because, reason = "", kind = "danger", act }) {
  const dialog = $("ask"), why = h("input", { id: "ask-why", maxLength: 500, autocomplete: "off", value: reason });
  const stay = button(keep, () => dialog.close(), { id: "ask-keep" });
  const go = button(verb, () => order(async () => {
    const text = why.value.trim();
    if (because && !text) { why.focus(); throw new Error(because); }
    dialog.close();
    await act(text);
  }), { id: "ask-go", kind });
  dialog.setAttribute("aria-label", title);
  dialog.replaceChildren(h("h2", {}, title), h("p", {}, body), h("label", { className: "field" }, h("span", {}, t("reasonKept")), why), h("div", { className: "row end" }, stay, go));
  dialog.show(); stay.focus();
}

// The item of a menu that deletes what is kept under a path. `away`: the address to go to.
export const deletion = (path, name, away) => {
  const what = path.split("/")[1];
  return !looksOn() && { text: t(`delete_${what}`), bad: true, act: () => askAgain({
    title: t("deleteNamed", { name }), body: t(`deleteBody_${what}`), keep: t("keepIt"), verb: t(`deleteVerb_${what}`), because: t("sayWhyDeleted"),
    act: async (reason) => { await ask("DELETE", `${path}?${new URLSearchParams({ reason })}`, undefined, held()); if (away) location.hash = away; },
  }) };
};
