// Which readings of a run count, and how far the reference pose has drifted by them.

import { length, minus } from "./units.js";

// A point where it would be at the joints planned: a robot driven by hand stands beside them. Old records do not say.
export const asPlanned = (data) => data.as_planned_mm || data.world_mm;

// The readings of points among `events` but for those that were measured again, while the arm warmed up for one.
export function counted(events) {
  const again = new Set(events.filter((each) => each.kind === "measure_again").flatMap((each) => each.data.poses));
  return events.filter(({ kind, data }) => kind === "reading" && data.world_mm && !again.has(data.pose));
}

// {target: [{utc, y}]}: the distance of every reading of the reference pose from the first of its target, mm.
export function driftsOf(readings) {
  const first = {}, drifts = {};
  for (const { data, utc } of readings.filter((each) => each.data.set === "reference")) {
    const point = asPlanned(data), from = first[data.target] = first[data.target] || point;
    (drifts[data.target] = drifts[data.target] || []).push({ utc, y: length(minus(point, from)) });
  }
  return drifts;
}
