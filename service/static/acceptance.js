// Acceptance: the limits that an identification or a diagnosis is judged by, and the verdict with its guard bands.

import { badge, h, numeric, table } from "./dom.js";
import { number } from "./units.js";
import { t } from "./words.js";

const chosen = { accept_rms_mm: 0, accept_max_mm: 0 };

// The limits as a request has them; 0: none.
export const asked = () => ({ ...chosen });

// The fields for them; what is typed holds for the next result that is asked for, in every view.
export function limits() {
  const field = (name, words) => {
    const input = h("input", { type: "number", min: 0, step: "any", inputMode: "decimal", value: chosen[name] || "", on: { input: () => { chosen[name] = input.valueAsNumber > 0 ? input.valueAsNumber : 0; } } });
    return h("label", {}, words, " ", input);
  };
  return h("fieldset", { className: "row limits" }, h("legend", {}, t("acceptIf")), field("accept_rms_mm", t("acceptRms")), field("accept_max_mm", t("acceptMax")));
}

// The verdict with its figures, as a strip; nothing where no limit was set.
export function acceptance(found) {
  if (!found) return null;
  const kind = { accepted: "ok", rejected: "bad" }[found.verdict] || "open";
  return h("div", { id: "acceptance", className: `accept ${kind}` }, badge(kind, t(`accept_${found.verdict}`)), h("dl", {}, found.criteria.map((each) => h("div", {}, h("dt", {}, `${each.zone ? `${each.zone}: ` : ""}${t(`quantity_${each.quantity}`)}`),
    h("dd", {}, `${number(each.figure_mm)}${each.expanded_uncertainty_mm === null ? "" : ` ± ${number(each.expanded_uncertainty_mm)}`} mm`), h("dd", { className: "sub" }, `${t("limit")} ${number(each.limit_mm)} mm`)))));
}

// How it was decided, in a table and by its rule.
export const acceptanceTable = (found) => [table(t("acceptance"), [t("quantity"), t("verdict"), t("error"), t("limit"), "U"], found.criteria.map((each) => [`${each.zone ? `${each.zone}: ` : ""}${t(`quantity_${each.quantity}`)}`, t(`accept_${each.verdict}`), numeric(`${number(each.figure_mm)} mm`),
  numeric(`${number(each.limit_mm)} mm`), numeric(each.expanded_uncertainty_mm === null ? "–" : `${number(each.expanded_uncertainty_mm)} mm`)])), h("p", { className: "sub" }, found.rule)];
