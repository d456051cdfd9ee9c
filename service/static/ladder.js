// The ladder of a result: the position error of every model, from the robot as found to the robot verified.

import { bars } from "./charts.js";
import { h, numeric, table } from "./dom.js";
import { number } from "./units.js";
import { t } from "./words.js";

export function rungs(job) {
  const r = job.result || {}, v = r.verification || {};
  return [
    [t("rungNominal"), r.error_nominal_mm], [t("rungBase"), r.error_before_mm || r.error_identified_mm],
    [t("rungEffects"), (r.effects || []).length ? r.error_after_mm : null], [t("rungUncorrected"), v.error_uncorrected_mm], [t("rungVerified"), v.error_verified_mm],
  ].filter(([, errors]) => errors);
}

export function errorsOf(job) {
  const all = rungs(job), others = all.filter(([name]) => name !== t("rungUncorrected")), held = others.length > 1 ? others : all;  // a verification has no other
  return { first: held.length ? held[0][1].rms : null, last: held.length ? held.at(-1)[1].rms : null };
}

// What a diagnosis is judged by: readings held out, or else the errors that the robot has shown where the loop verified it.
export function judged(job) {
  const r = job.result || {}, v = r.verification, held = { ...job, result: { ...r, verification: null } };
  const onRobot = !rungs(held).length && v && v.error_uncorrected_mm, by = onRobot ? job : held;
  return { by, poses: onRobot ? v.poses : 0, ...errorsOf(by) };
}

// Whether the verdict leaves no error without a cause.
export const causesKnown = (result) => !["unexplained", "excess_noise"].includes(result.verdict);

const KINDS = ["before", "between", "after"];

export function ladder(job) {
  const rows = rungs(job);
  return rows.length ? bars(t("ladder"), rows.map(([name, errors], i) => [name, errors.rms, `${number(errors.rms)} mm`, name === t("rungUncorrected") ? "before" : KINDS[Math.min(i, 2)]])) : h("p", {}, t("nothingHeldOut"));
}

// All figures of the ladder, as a table.
export function errorTable(job) {
  const rows = rungs(job), figure = (errors, name) => numeric(number(errors[name]));
  return table(t("ladderCaption"), [t("model"), "n", t("mean"), "RMS", "95 %", t("most")], rows.map(([name, errors]) => [name, numeric(String(errors.n)), figure(errors, "mean"), figure(errors, "rms"), figure(errors, "p95"), figure(errors, "max")]));
}
