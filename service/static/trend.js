// Trends of a history: a small picture of the last errors, and the control chart of a parameter with U and limits.

import { chart } from "./charts.js";
import { fold, h } from "./dom.js";
import { day, withU } from "./history.js";
import { t } from "./words.js";

const seconds = (text) => new Date(text).getTime() / 1000, SHOWN = 3;  // signals, the newest
const days = (u, splits) => splits.map((each) => new Date(1000 * each).toLocaleDateString("en", { month: "short", year: "2-digit" }));

// The last errors from nought, with what is permitted as a dashed line.
export function sparkline(errors, permitted) {
  const last = errors.at(-1), says = t("sparkSays", { n: errors.length, first: day(errors[0].measured), last: withU(last.rms, last.u, "mm") }), drawn = chart(says, { height: 90, className: "spark", bare: true });
  drawn.set({ says, x: { time: days }, y: { from: 0 }, limit: permitted ? { y: permitted, words: t("permitted") } : null, series: [{ name: "", colour: "mark", points: errors.map((each) => ({ x: seconds(each.measured), y: each.rms, u: each.u, tip: `${day(each.measured)}: ${withU(each.rms, each.u, "mm")}` })) }] });
  return drawn;
}

// One parameter: values with U, the centre, the limits of every value; a signal has a ring and is listed.
function trendPicture(trend, permitted) {
  const { values } = trend, charted = values.filter((each) => each.limits), last = values.at(-1), out = values.filter((each) => each.signal).length, says = t("trendSays", { name: nameOf(trend.parameter), n: values.length, last: withU(last.value, last.u, trend.unit), out });
  const drawn = chart(says, { height: 210, className: "trend" }), limit = (side, name) => ({ name, kind: "steps", colour: "between", points: charted.map((each) => ({ x: seconds(each.measured), y: each.limits[side], tip: t("markLimits") })) });
  drawn.set({ says, x: { time: days }, limit: permitted ? { y: permitted, words: t("permitted") } : null, series: [
    { name: t("markValue"), kind: "dots", colour: "mark", points: values.map((each) => ({ x: seconds(each.measured), y: each.value, u: each.u, signal: each.signal, tip: `${day(each.measured)}: ${withU(each.value, each.u, trend.unit)}` })) },
    ...(charted.length ? [limit(0, t("markLimits")), limit(1, "")] : []), ...(trend.centre !== null && values.length > 1 ? [{ name: t("markCentre"), kind: "dash", colour: "before", points: [values[0], last].map((each) => ({ x: seconds(each.measured), y: trend.centre, tip: t("markCentre") })) }] : [])] });
  drawn.dataset.limits = String(charted.length ? 2 : 0);
  return drawn;
}

export const nameOf = (parameter) => (parameter === "error_rms" ? t("positionError") : parameter);

const signalsOf = (signals) => (signals.length ? h("ul", { className: "plain" }, signals.map((each) => h("li", {}, "! ", each))) : null);

// A parameter with its picture and what is said of it.
export function trendCard(trend, { wide = false, permitted = null } = {}) {
  const last = trend.values.at(-1);
  return h("article", { className: wide ? "trend-card wide" : "trend-card" }, h("h3", {}, `${nameOf(trend.parameter)}${trend.unit ? `, ${trend.unit}` : ""}`),
    h("p", {}, `${t("lastValue")}: ${withU(last.value, last.u, trend.unit)} (${day(last.measured)})`), trendPicture(trend, permitted),
    signalsOf(trend.signals.slice(-SHOWN)), trend.signals.length > SHOWN ? fold(t("earlierSignals", { n: trend.signals.length - SHOWN }), "", signalsOf(trend.signals.slice(0, -SHOWN))) : null,
    trend.no_chart_because ? h("p", { className: "sub" }, trend.no_chart_because) : null, trend.left_out ? h("p", { className: "sub" }, t("olderLeftOut", { n: trend.left_out })) : null);
}
