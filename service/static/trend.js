// Trends of a history: a small picture of the last errors, and the control chart of a parameter with U and limits.

import { h, svg } from "./dom.js";
import { day, withU } from "./history.js";
import { t } from "./words.js";

const time = (text) => new Date(text).getTime();
const spread = (values, room) => {
  const low = Math.min(...values), high = Math.max(...values), more = (high - low || Math.abs(high) || 1) * room;
  return [low - more, high + more];
};
const at = (value, [low, high], from, to) => from + (to - from) * (high === low ? 0.5 : (value - low) / (high - low));

// The last errors from nought, with what is permitted as a dashed line.
export function sparkline(errors, permitted) {
  const W = 180, H = 44, last = errors.at(-1), most = 1.15 * Math.max(permitted || 0, ...errors.map((each) => each.rms));
  const times = [time(errors[0].measured), time(last.measured)];
  const places = errors.map((each) => [at(time(each.measured), times, 6, W - 8), at(each.rms, [0, most], H - 4, 4)]);
  return svg("svg", { viewBox: `0 0 ${W} ${H}`, role: "img", class: "spark", "aria-label": t("sparkSays", { n: errors.length, first: day(errors[0].measured), last: withU(last.rms, last.u, "mm") }) },
    svg("path", { d: `M2 ${H - 4}H${W - 2}`, class: "axis" }),
    permitted ? svg("path", { d: `M2 ${at(permitted, [0, most], H - 4, 4)}H${W - 2}`, class: "limit" }) : null,
    svg("polyline", { points: places.map((p) => p.map((v) => v.toFixed(1)).join()).join(" "), class: "way-of" }),
    places.map(([x, y], i) => svg("circle", { cx: x.toFixed(1), cy: y.toFixed(1), r: i === places.length - 1 ? 4 : 2.4, class: "value" })));
}

const L = 62, R = 12, T = 10, B = 26, H = 200;

// Ticks at round numbers, some three of them.
function ticks([low, high]) {
  const step = 10 ** Math.floor(Math.log10(high - low)), by = [0.2, 0.5, 1, 2, 5].map((each) => each * step).find((each) => (high - low) / each <= 4) || step;
  const found = [];
  for (let i = Math.ceil(low / by); i * by <= high; i += 1) found.push(i * by);
  return { found, digits: Math.min(6, Math.max(0, -Math.floor(Math.log10(by)))) };
}

// One parameter: values with U, the centre, the limits of every value; a signal has a ring and a letter.
export function trendPicture(trend, W, permitted) {
  const { values } = trend, charted = values.filter((each) => each.limits);
  const range = spread([...values.flatMap((each) => [each.value - (each.u || 0), each.value + (each.u || 0)]), ...charted.flatMap((each) => each.limits), ...(permitted ? [permitted] : [])], 0.06);
  const times = values.length > 1 ? [time(values[0].measured), time(values.at(-1).measured)] : [0, 0];
  const x = (each) => at(time(each.measured), times, L + 12, W - R - 12), y = (value) => at(value, range, H - B, T);
  const { found, digits } = ticks(range), label = (px, py, anchor, words) => svg("text", { x: px, y: py, "text-anchor": anchor }, words);
  const parts = [svg("path", { d: `M${L} ${T}V${H - B}H${W - R}`, class: "axis" }),
    found.map((each) => [svg("path", { d: `M${L - 4} ${y(each).toFixed(1)}H${L}`, class: "axis" }), label(L - 7, y(each) + 4, "end", each.toFixed(digits).replace("-", "−"))]),
    label(L + 2, H - 8, "start", day(values[0].measured)), values.length > 1 ? label(W - R, H - 8, "end", day(values.at(-1).measured)) : null];
  if (trend.centre !== null) parts.push(svg("path", { d: `M${L} ${y(trend.centre).toFixed(1)}H${W - R}`, class: "centre" }));
  if (permitted) parts.push(svg("path", { d: `M${L} ${y(permitted).toFixed(1)}H${W - R}`, class: "permitted" }), label(L + 6, y(permitted) + 15, "start", t("permitted")));
  for (const side of [0, 1]) {
    const steps = charted.map((each, i) => {
      const before = i ? (x(charted[i - 1]) + x(each)) / 2 : L, after = i < charted.length - 1 ? (x(each) + x(charted[i + 1])) / 2 : W - R;
      return `${i ? "L" : "M"}${before.toFixed(1)} ${y(each.limits[side]).toFixed(1)}H${after.toFixed(1)}`;
    });
    if (steps.length) parts.push(svg("path", { d: steps.join(""), class: "limit", fill: "none" }));
  }
  for (const each of values) {
    const px = x(each).toFixed(1), py = y(each.value).toFixed(1);
    if (each.u) parts.push(svg("path", { d: `M${px} ${y(each.value - each.u).toFixed(1)}V${y(each.value + each.u).toFixed(1)}`, class: "whisker" }));
    parts.push(svg("circle", { cx: px, cy: py, r: 3.6, class: "value" }));
    if (each.signal) parts.push(svg("circle", { cx: px, cy: py, r: 8, class: "ring" }), label(Number(px) - 12, Number(py) + 4, "end", "!"));
  }
  const last = values.at(-1), out = values.filter((each) => each.signal).length;
  return svg("svg", { viewBox: `0 0 ${W} ${H}`, role: "img", class: "trend", "aria-label": t("trendSays", { name: nameOf(trend.parameter), n: values.length, last: withU(last.value, last.u, trend.unit), out }) }, parts);
}

export const nameOf = (parameter) => (parameter === "error_rms" ? t("positionError") : parameter);

const SHOWN = 3;  // signals, the newest
const signalsOf = (signals) => (signals.length ? h("ul", { className: "signals" }, signals.map((each) => h("li", {}, "! ", each))) : null);

// A parameter with its picture and what is said of it.
export function trendCard(trend, { wide = false, permitted = null } = {}) {
  const last = trend.values.at(-1), W = innerWidth < 700 ? 330 : wide ? 860 : 420;
  return h("article", { className: wide ? "trend-card wide" : "trend-card" }, h("h3", {}, `${nameOf(trend.parameter)}${trend.unit ? `, ${trend.unit}` : ""}`),
    h("p", {}, `${t("lastValue")}: ${withU(last.value, last.u, trend.unit)} (${day(last.measured)})`), trendPicture(trend, W, permitted),
    signalsOf(trend.signals.slice(-SHOWN)), trend.signals.length > SHOWN ? h("details", {}, h("summary", {}, t("earlierSignals", { n: trend.signals.length - SHOWN })), signalsOf(trend.signals.slice(0, -SHOWN))) : null,
    trend.no_chart_because ? h("p", { className: "dim" }, trend.no_chart_because) : null, trend.left_out ? h("p", { className: "dim" }, t("olderLeftOut", { n: trend.left_out })) : null);
}

// What the marks mean, once for all pictures.
export function legend() {
  const mark = (name, ...parts) => h("span", {}, svg("svg", { viewBox: "0 0 28 18", width: 28, height: 18, "aria-hidden": "true" }, parts), " ", t(name));
  return h("p", { className: "marks" },
    mark("markValue", svg("path", { d: "M14 2V16", class: "whisker" }), svg("circle", { cx: 14, cy: 9, r: 3.6, class: "value" })), mark("markLimits", svg("path", { d: "M1 9H27", class: "limit" })),
    mark("markCentre", svg("path", { d: "M1 9H27", class: "centre" })), mark("markSignal", svg("circle", { cx: 16, cy: 9, r: 7, class: "ring" }), svg("circle", { cx: 16, cy: 9, r: 3.6, class: "value" }), svg("text", { x: 0, y: 14 }, "!")));
}
