// Deleting what was kept, for a reason that stays, and the trail of what was deleted.

import { ask } from "./connection.js";
import { held, looksOn, order } from "./desk.js";
import { button, fill, h, table } from "./dom.js";
import { moment } from "./units.js";
import { t } from "./words.js";

// A part to open with the reason and the button: two steps, so that no single touch deletes. `away`: the address to go to.
export function deleting(path, name, away) {
  const what = t(`delete_${path.split("/")[1]}`), reason = h("input", { maxLength: 500, size: 30 }), row = h("div", { className: "row" });
  const act = button(t("deleteForGood"), () => order(async () => {
    const why = reason.value.trim();
    if (!why) { reason.focus(); throw new Error(t("sayWhyDeleted")); }
    await ask("DELETE", `${path}?${new URLSearchParams({ reason: why })}`, undefined, held());
    if (away) location.hash = away; else whole.remove();
  }), { className: "delete" });
  row.append(h("label", {}, t("reason"), " ", reason), act);
  const whole = h("details", { className: "deleting" }, h("summary", { ariaLabel: `${what}: ${name}` }, what), row);
  whole.show = () => { whole.hidden = looksOn(); };
  whole.show();
  return whole;
}

// What was deleted from this record, newest first; `look()` reads it when it is open.
export function trail() {
  const list = h("div", {}), whole = h("details", { id: "trail" }, h("summary", {}, t("deletedSoFar")), list);
  whole.addEventListener("toggle", () => { if (whole.open) order(whole.look); });
  whole.look = async () => {
    if (!whole.open) return;
    const { deletions } = await ask("GET", "/deletions");
    fill(list, deletions.length, () => (deletions.length ? table(t("deletedSoFar"), [t("when"), t("what"), t("by"), t("reason")],
      deletions.slice().reverse().map((each) => [moment(new Date(each.utc)), `${t(`kind_${each.kind}`)} ${each.name || each.id}`, each.by, each.reason])) : h("p", {}, t("nothingDeleted"))));
  };
  return whole;
}
