// What the views of the history share: the state of a robot in words and sign, dates with their year, values with U.

import { h } from "./dom.js";
import { KEYS, t } from "./words.js";

// Not by colour alone: every state has a sign of its own.
const SIGNS = { unchanged: "✔", recalibrated: "⟳", changed: "✖", ambiguous: "?", unexplained: "‼", not_watched: "○", retired: "□" };
export const stateOf = (name) => h("span", { className: `robot-state ${name}` }, `${SIGNS[name] || "•"} ${t(`robot_${name}`)}`);

export const day = (text) => new Date(text).toLocaleDateString("en", { year: "numeric", month: "short", day: "numeric" });

const MOST = 6;
const minus = (text) => text.replace("-", "−");
const digitsOf = (u) => Math.min(MOST, Math.max(0, 1 - Math.floor(Math.log10(u))));

// A value as its U lets it be read: two digits of U.
export function withU(value, u, unit = "") {
  if (typeof value !== "number") return "–";
  const text = u > 0 ? `${value.toFixed(digitsOf(u))} ± ${u.toFixed(digitsOf(u))}` : value.toPrecision(4);
  return minus(unit ? `${text} ${unit}` : text);
}

// What was said of a robot last, by a watch or by a diagnosis: the list says the same as the newest result.
export const lastSaid = ({ watched, diagnosed }) => (watched && diagnosed ? (watched.measured >= diagnosed.measured ? watched : diagnosed) : watched || diagnosed);

// A cause as the operator knows it; the label of one that has no words here.
export function causeName(label) {
  const [, kind, joint] = label.match(/^([a-z_]+)(?::j(\d+))?/) || [];
  return KEYS.includes(`cause_${kind}`) ? t(`cause_${kind}`, { joint }) : label;
}

export const causeOf = (cause) => [causeName(cause.label), typeof cause.value === "number" ? withU(cause.value, cause.u, cause.unit) : "",
  typeof cause.weight === "number" && cause.weight < 0.995 ? `${Math.round(100 * cause.weight)} %` : ""].filter(Boolean).join(", ");

// The date of the next check: a sign and a word where it has passed, and why there is none.
export function dueOf(due) {
  if (!due.date) return h("span", { className: "sub" }, t("noDate"));
  return h("span", { className: due.overdue ? "overdue" : "" }, due.overdue ? `⚠ ${t("overdueSince", { date: day(due.date) })}` : day(due.date));
}
