// The poses of a plan as marks in space, with what became of each.

import { h } from "./dom.js";
import { t } from "./words.js";

export const status = (visit) => {
  const all = visit.readings.map((each) => each.status);
  return all.every((each) => each === "measured") ? "measured" : all.some((each) => each === "measured") ? "begun" : all.every((each) => each === "skipped") ? "skipped" : all.includes("deferred") ? "deferred" : "planned";
};

// The poses of a plan, each as its visits: with one SMR a pose is visited once for every target.
export function posesOf(plan) {
  const poses = new Map();
  for (const visit of plan.visits.filter((each) => each.kind === "pose" && each.set !== "reference")) {
    const key = JSON.stringify([visit.set, visit.joints_deg]);
    poses.set(key, [...(poses.get(key) || []), visit]);
  }
  return [...poses.values()];
}

// The marks of a plan: every visit where its first target should be. `now`: the visit in hand; `chosen`: the one that was picked.
export function marks(plan, now = null, chosen = null) {
  return plan.visits.filter((visit) => visit.kind === "pose" && visit.readings[0].expected_mm).map((visit) => {
    const here = visit.number === now, is = status(visit);
    return { at: visit.readings[0].expected_mm, square: visit.set === "validation", shape: here ? "now" : is === "begun" ? "measured" : is, label: visit.name, id: visit.number, tip: `${visit.number}: ${visit.name} (${t(here ? "inHand" : is)})`, chosen: visit.number === chosen };
  });
}

export const legend = () => h("p", { className: "sub legend" }, `○ ${t("planned")} · ● ${t("measured")} · ■ ${t("validation")} · ✕ ${t("skipped")} · ◎ ${t("inHand")}`);
