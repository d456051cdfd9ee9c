// Acceptance: the limits that an identification or a diagnosis is judged by, and the verdict with its guard bands.

import { h, numeric, table } from "./dom.js";
import { number } from "./units.js";
import { t } from "./words.js";

const chosen = { accept_rms_mm: 0, accept_max_mm: 0 }, SIGNS = { accepted: "✔", rejected: "✖", not_decided: "?" };

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

export function acceptance(found) {
  if (!found) return null;
  const says = (verdict) => `${SIGNS[verdict] || "•"} ${t(`accept_${verdict}`)}`;
  return h("div", { id: "acceptance" }, h("p", { className: "big" }, says(found.verdict)),
    table(t("acceptance"), ["", t("verdict"), t("error"), t("limit"), "U"], found.criteria.map((each) => [`${each.zone ? `${each.zone}: ` : ""}${t(`quantity_${each.quantity}`)}`, says(each.verdict), numeric(`${number(each.figure_mm)} mm`),
      numeric(`${number(each.limit_mm)} mm`), numeric(each.expanded_uncertainty_mm === null ? "–" : `${number(each.expanded_uncertainty_mm)} mm`)])), h("p", { className: "dim" }, found.rule));
}
