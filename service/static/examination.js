// The examination of the cell's devices: whether a campaign can begin, and else what to do.

import { bearer, reach } from "./connection.js";
import { desk, looksOn, order } from "./desk.js";
import { button, h, table } from "./dom.js";
import { number } from "./units.js";
import { KEYS, t } from "./words.js";

const PATIENCE_MS = 120000, SIGNS = { ok: "✔", note: "•", fault: "✖" };

export function examination() {
  const told = h("div", { id: "examined", role: "status" });
  const begin = button(t("examine"), () => order(async () => {
    told.replaceChildren(h("p", {}, t("examining")));
    try { told.replaceChildren(...words(await reach("/cell/examination", { method: "POST", headers: bearer() }, PATIENCE_MS, (answer) => answer.json()))); }
    catch (error) { told.replaceChildren(); throw error; }
  }), { id: "examine" });
  const whole = h("section", { className: "wide" }, h("h2", {}, t("examination")), h("p", { className: "dim" }, t("examineHint")), h("div", { className: "row" }, begin), told);
  whole.show = () => { whole.hidden = looksOn(); begin.disabled = Boolean(desk.cell && (desk.cell.run_id || desk.cell.loop_id)); };
  return whole;
}

const named = (check) => (KEYS.includes(`check_${check}`) ? t(`check_${check}`) : check);
const rows = (findings) => table(t("examination"), [t("check"), t("found")],
  findings.map((each) => [`${SIGNS[each.level]} ${t(`level_${each.level}`)} · ${t(`device_${each.device}`)}: ${named(each.check)}`, [h("div", {}, each.found), each.do ? h("div", {}, h("strong", {}, `${t("whatToDo")} `), each.do) : null]]));

function words(found) {
  const some = found.findings.filter((each) => each.level !== "ok"), good = found.findings.filter((each) => each.level === "ok");
  return [h("p", { className: "big" }, found.healthy ? t("healthy") : t("notHealthy")), h("p", { className: "dim" }, t("examinedIn", { n: found.findings.length, s: number(found.seconds, 1) })),
    some.length ? rows(some) : null, h("details", {}, h("summary", {}, t("goodChecks", { n: good.length })), rows(good))].filter(Boolean);
}
