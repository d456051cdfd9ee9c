// The examination of the cell's devices: whether a campaign can begin, and else what to do.

import { bearer, reach } from "./connection.js";
import { desk, looksOn, order } from "./desk.js";
import { button, h, table } from "./dom.js";
import { t } from "./words.js";

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

const rows = (findings) => table(t("examination"), ["", t("device"), t("check"), t("found"), t("whatToDo")],
  findings.map((each) => [`${SIGNS[each.level]} ${t(`level_${each.level}`)}`, each.device, each.check, each.found, each.do]));

function words(found) {
  const some = found.findings.filter((each) => each.level !== "ok"), good = found.findings.filter((each) => each.level === "ok");
  return [h("p", { className: "big" }, found.healthy ? t("healthy") : t("notHealthy")), h("p", { lang: "en", className: "dim" }, found.verdict),
    some.length ? h("div", { lang: "en" }, rows(some)) : null, h("details", { lang: "en" }, h("summary", {}, t("goodChecks", { n: good.length })), rows(good))].filter(Boolean);
}
