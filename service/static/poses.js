// One pose of a plan: its readings, what it is worth, and measuring it again or leaving it out. It is chosen here, in the
// picture, or in the chart.

import { ask, reckoned } from "./connection.js";
import { desk, looksOn, moving, order } from "./desk.js";
import { button, fill, h } from "./dom.js";
import { status } from "./plan.js";
import { duration, number } from "./units.js";
import { t } from "./words.js";

const MOST = 400, SIGNS = { measured: "●", begun: "◐", planned: "○", deferred: "◌", skipped: "✕" };

// A card with `show(plan, run)` and `choose(number)`. `changed()`: the plan is another now; `pick(number)`: chosen here.
export function poseCard(run, changed, pick) {
  const choice = h("select", { id: "pose" }), price = h("div", { id: "price", role: "status" }), reason = h("input", { id: "pose-reason", maxLength: 500 });
  const tell = (verb) => order(async () => {
    await ask("POST", `/runs/${run().id}/visits/${choice.value}/${verb}`, { reason: reason.value }, moving());
    reason.value = ""; price.replaceChildren();
    await changed();
  });
  const again = button(t("retake"), () => tell("retake"), { id: "retake", disabled: true, ic: "again" }), skip = button(t("skipPose"), () => tell("skip"), { id: "skip-pose", disabled: true, ic: "skip" });
  const acts = h("div", { className: "stack" }, h("label", { className: "field" }, h("span", {}, t("reason")), reason), h("div", { className: "row" }, again, skip), h("p", { className: "sub" }, t("retakeHint")));
  const whole = h("section", { id: "poses", className: "card", hidden: true }, h("h2", {}, h("label", { htmlFor: "pose" }, t("poseChosen"))), choice, price, acts);
  let plan = null, asked = "";

  choice.addEventListener("change", () => pick(choice.value === "" ? null : Number(choice.value)));
  whole.choose = (number) => {
    choice.value = number === null ? "" : String(number);
    price.replaceChildren(); asked = choice.value;
    whole.show(plan, run());
    if (asked === "") return;
    const mine = asked;
    price.replaceChildren(t("reckoningPrice"));
    order(async () => {
      try { const told = words(await reckoned(`/runs/${run().id}/visits/${mine}/price`)); if (mine === asked) price.replaceChildren(...told); }
      catch (error) { if (mine === asked) price.replaceChildren(); throw error; }
    });
  };
  whole.show = (of, shown) => {
    plan = of;
    whole.hidden = !plan || !shown || shown.dry_run;
    if (whole.hidden) return;
    const visits = plan.visits.filter((visit) => visit.seconds !== null).slice(0, MOST), at = choice.value;
    fill(choice, visits.map((visit) => [visit.number, status(visit)]), () => [h("option", { value: "" }, t("choosePose")), ...visits.map((visit) => h("option", { value: visit.number }, `${SIGNS[status(visit)]} ${visit.number}: ${visit.name} (${t(status(visit))})`))]);
    choice.value = at;
    const here = visits.find((visit) => String(visit.number) === choice.value), over = ["succeeded", "failed"].includes(shown.state) || looksOn();
    const has = (...names) => Boolean(here) && here.readings.some((each) => names.includes(each.status));
    acts.hidden = !here || over;
    again.disabled = over || !desk.lease || !has("measured", "skipped"); skip.disabled = over || !has("planned", "deferred");
  };
  return whole;
}

function words(price) {
  const time = duration(price.seconds), now = price.u_mm, without = price.u_without_mm;
  if (price.set === "validation") return [h("p", {}, t("priceValidation", { time }))];
  if (!now) return [h("p", {}, t("priceUnknown", { time }))];
  const lost = without ? t("priceWithout", { u: number(without.max, 4), more: number(without.max - now.max, 4) }) : t("priceEverything");
  return [h("p", {}, t("priceNow", { u: number(now.max, 4) }), " ", lost), h("p", {}, t("priceAgain", { time }))];
}
