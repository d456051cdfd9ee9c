// Numbers, times and words as people read them.

import { clock } from "./connection.js";
import { t } from "./words.js";

export const number = (x, digits = 3) => (typeof x === "number" ? x.toFixed(digits).replace("-", "−") : "–");
export const mm = (x) => (typeof x === "number" ? `${number(x)} mm` : "–");
export const length = (vector) => Math.hypot(...vector);
export const minus = (a, b) => a.map((x, i) => x - b[i]);

export function duration(s) {
  if (typeof s !== "number") return "–";
  return s < 100 ? t("seconds", { n: Math.ceil(s) }) : s < 6000 ? t("minutes", { n: (s / 60).toFixed(0) }) : t("hours", { n: (s / 3600).toFixed(1) });
}

// A moment: the time of day, with the day where it is another one than today.
export function moment(date, now = new Date()) {
  const day = date.toDateString() === now.toDateString() ? "" : `${date.toLocaleDateString("en", { weekday: "short", day: "numeric", month: "short" })} `;
  return day + clock(date, 5);
}

// A forecast counts down while a person is waited for, and is 0 or missing before there is one: then it is not shown.
export function timeLeft(of, looking, now = new Date()) {
  if (of.state === "waiting_for_operator") return looking ? t("waitsForOperator") : t("waitsForYou");
  if (of.state !== "running") return "";
  const s = of.seconds_left;
  if (!s) return of.total && of.done >= of.total ? t("allDone") : t("reckoning");
  return t("left", { left: duration(s), at: moment(new Date(now.getTime() + s * 1000), now) });
}

export const state = (name) => t(`state_${name}`);
// Not by colour alone: every state has a sign of its own.
const SIGNS = { draft: "○", ready: "○", running: "▶", waiting_for_operator: "?", paused: "‖", succeeded: "✔", failed: "✖", stopped: "■" };
export const sign = (name) => SIGNS[name] || "•";
