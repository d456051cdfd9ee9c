// A plan as a picture, in figures and as a list: poses, paths, boxes and time.

import { h } from "./dom.js";
import { scenePicture } from "./scene.js";
import { duration } from "./units.js";
import { t } from "./words.js";

export const status = (visit) => {
  const all = visit.readings.map((each) => each.status);
  return all.every((each) => each === "measured") ? "measured" : all.some((each) => each === "measured") ? "begun" : all.every((each) => each === "skipped") ? "skipped" : all.includes("deferred") ? "deferred" : "planned";
};

// The marks of a plan: every visit where its first target should be.
export function marks(plan, now = null) {
  return plan.visits.filter((visit) => visit.kind === "pose" && visit.readings[0].expected_mm).map((visit) => {
    const here = visit.number === now;
    return { at: visit.readings[0].expected_mm, square: visit.set === "validation", shape: here ? "now" : status(visit) === "begun" ? "measured" : status(visit), label: here ? visit.name : "" };
  });
}

export function planPicture() {
  const picture = scenePicture(t("planPicture")), facts = h("dl", { className: "facts" });
  const whole = h("div", {}, facts, picture, legend());
  const fact = (name, value) => h("div", {}, h("dt", {}, name), h("dd", {}, value));
  whole.show = (plan, scene) => {
    const posed = plan.visits.filter((visit) => visit.kind === "pose"), readings = plan.visits.filter((each) => each.seconds !== null).flatMap((each) => each.readings);
    facts.replaceChildren(fact(t("poses"), String(posed.length)), fact(t("readings"), String(readings.length)), fact(t("time"), duration(plan.seconds)),
      fact(t("overHome"), plan.detours === null ? t("notLooked") : String(plan.detours)));
    picture.show({ ...scene, path_mm: plan.path_mm, marks: marks(plan), described: t("planDescribed", { poses: posed.length, boxes: scene.obstacles.length }) });
  };
  whole.clear = () => { facts.replaceChildren(); picture.show({}); };
  return whole;
}

export const legend = () => h("p", { className: "dim legend" }, `○ ${t("planned")} · ● ${t("measured")} · ■ ${t("validation")} · ✕ ${t("skipped")} · ◎ ${t("inHand")} · ┄ ${t("way")}`);
