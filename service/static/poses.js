// The poses of a plan as a list: what became of each, what it is worth, and asking for it again or leaving it out.

import { ask, reckoned } from "./connection.js";
import { desk, looksOn, moving, order } from "./desk.js";
import { button, fill, h } from "./dom.js";
import { status } from "./plan.js";
import { duration, number } from "./units.js";
import { t } from "./words.js";

const MOST = 400, SIGNS = { measured: "●", begun: "◐", planned: "○", deferred: "◌", skipped: "✕" };

// A section with `show(plan, run)`. `changed`: the plan is another now.
export function poseList(run, changed) {
  const choice = h("select", { id: "pose" }), price = h("div", { id: "price", role: "status" }), reason = h("input", { id: "pose-reason", maxLength: 500, size: 24 });
  const order_ = (verb) => order(async () => {
    await ask("POST", `/runs/${run().id}/visits/${choice.value}/${verb}`, { reason: reason.value }, moving());
    reason.value = ""; price.replaceChildren();
    await changed();
  });
  const worth = button(t("whatWorth"), () => order(async () => {
    price.replaceChildren(t("reckoningPrice"));
    try { price.replaceChildren(...words(await reckoned(`/runs/${run().id}/visits/${choice.value}/price`))); }
    catch (error) { price.replaceChildren(); throw error; }
  }), { id: "worth" });
  const again = button(t("retake"), () => order_("retake"), { id: "retake", disabled: true }), skip = button(t("skipPose"), () => order_("skip"), { id: "skip-pose", disabled: true });
  const whole = h("section", { id: "poses", className: "wide", hidden: true }, h("h2", {}, h("label", { htmlFor: "pose" }, t("poses"))),
    h("div", { className: "row" }, choice, worth), price, h("div", { className: "row" }, again, skip, h("label", {}, t("reason"), " ", reason)), h("p", { className: "dim" }, t("retakeHint")));
  choice.addEventListener("change", () => { price.replaceChildren(); whole.show(plan, run()); });
  let plan = null;
  whole.show = (of, shown) => {
    plan = of;
    whole.hidden = !plan || !shown || shown.dry_run;
    if (whole.hidden) return;
    const visits = plan.visits.filter((visit) => visit.seconds !== null).slice(0, MOST);
    const at = choice.value;
    fill(choice, visits.map((visit) => [visit.number, status(visit)]), () => visits.map((visit) => h("option", { value: visit.number }, `${SIGNS[status(visit)]} ${visit.number}: ${visit.name} (${t(status(visit))})`)));
    if (at) choice.value = at;
    const here = visits.find((visit) => String(visit.number) === choice.value), over = ["succeeded", "failed"].includes(shown.state) || looksOn();
    const has = (...names) => Boolean(here) && here.readings.some((each) => names.includes(each.status));
    again.disabled = over || !desk.lease || !has("measured", "skipped"); skip.disabled = over || !has("planned", "deferred");
  };
  return whole;
}

function words(price) {
  const time = duration(price.seconds), now = price.u_mm, without = price.u_without_mm;
  if (["validation", "reference"].includes(price.set) && price.set === "validation") return [h("p", {}, t("priceValidation", { time }))];
  if (!now) return [h("p", {}, t("priceUnknown", { time }))];
  const lost = without ? t("priceWithout", { u: number(without.max, 4), more: number(without.max - now.max, 4) }) : t("priceEverything");
  return [h("p", {}, t("priceNow", { u: number(now.max, 4) }), " ", lost), h("p", {}, t("priceAgain", { time }))];
}
