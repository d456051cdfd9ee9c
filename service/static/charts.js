// Strips over time: the drift of the reference pose and the errors of readings, each with its limit and from nought.

import { clock } from "./connection.js";
import { svg } from "./dom.js";
import { number } from "./units.js";
import { t } from "./words.js";

const H = 210, L = 74, B = 30, R = 14, LINE = 19, LETTER = 6.6, SHORT_MS = 600000;  // LETTER: of 12 px, on the wide side
// Series are told apart by the shape of their points as well as by colour.
const LOOKS = [["#1a5fb4", "circle"], ["#9a4a10", "square"], ["#17633a", "diamond"], ["#74398f", "cross"]];

function point(shape, x, y, fill) {
  if (shape === "square") return svg("rect", { x: x - 3, y: y - 3, width: 6, height: 6, fill });
  if (shape === "diamond") return svg("path", { d: `M${x} ${y - 4.5}L${x + 4.5} ${y}L${x} ${y + 4.5}L${x - 4.5} ${y}Z`, fill });
  if (shape === "cross") return svg("path", { d: `M${x - 3.5} ${y - 3.5}l7 7M${x + 3.5} ${y - 3.5}l-7 7`, stroke: fill, "stroke-width": 2 });
  return svg("circle", { cx: x, cy: y, r: 3.2, fill });
}

// What stands above a plot of width W: [{at, line, mark, words}], as many lines as its words need.
function legendOf(entries, W) {
  const start = W < 500 ? 0 : L;  // on a telephone every letter counts
  let at = start, line = 0;
  return entries.map(([mark, words]) => {
    const wide = 34 + LETTER * words.length;
    if (at > start && at + wide > W) { at = start; line += 1; }
    const placed = { at: at + 12, line, mark, words };
    at += wide;
    return placed;
  });
}

// A strip of `series` {name: [{utc, y}]}, mm, with one nought and scale for all; `limit` {mm, words} is drawn and said.
// All words stand outside the plot, where no curve crosses them.
export function strip(target, series, { limit, name, joined = true }) {
  const W = Math.max(target.clientWidth || 480, 280), all = Object.values(series).flat();
  const most = Math.max(0.01, limit ? limit.mm * 1.15 : 0, ...all.map((each) => each.y * 1.1));
  const looks = Object.keys(series).map((each, i) => [LOOKS[i % LOOKS.length], each]);
  const legend = legendOf([...looks, ...(limit ? [[null, limit.words]] : [])], W), T = 14 + LINE * (legend.length ? legend.at(-1).line + 1 : 0);
  const times = all.map((each) => new Date(each.utc).getTime()), first = Math.min(...times), last = Math.max(first + 1000, ...times);
  const x = (utc) => L + (W - L - R) * (new Date(utc).getTime() - first) / (last - first), y = (value) => H - B - (H - B - T) * value / most;
  const label = (at, height, anchor, words) => svg("text", { x: at, y: height, "text-anchor": anchor }, words);
  const parts = [svg("path", { d: `M${L} ${T}V${H - B}H${W - R}`, class: "axis" }), label(L - 8, T + 5, "end", `${number(most)} mm`), label(L - 8, H - B + 4, "end", "0 mm")];
  const digits = last - first < SHORT_MS ? 8 : 5;  // with seconds, or without
  if (all.length) parts.push(label(L, H - 9, "start", clock(new Date(first), digits)), label(W - R, H - 9, "end", clock(new Date(last), digits)));
  else parts.push(label((L + W) / 2, (T + H - B) / 2 + 4, "middle", t("noneYet")));
  if (limit) parts.push(svg("line", { x1: L, x2: W - R, y1: y(limit.mm), y2: y(limit.mm), class: "limit" }));
  Object.values(series).forEach((own, i) => {
    const [colour, shape] = looks[i][0], places = own.map((one) => [x(one.utc), y(one.y)]);
    if (joined) parts.push(svg("polyline", { points: places.map((p) => p.map((v) => v.toFixed(1)).join()).join(" "), fill: "none", stroke: colour, "stroke-width": 1.5 }));
    parts.push(...places.map(([a, b]) => point(shape, a, b, colour)));
  });
  for (const { at, line, mark, words } of legend) {
    const height = 10 + LINE * line;
    parts.push(mark ? point(mark[1], at, height, mark[0]) : svg("line", { x1: at - 10, x2: at + 6, y1: height, y2: height, class: "limit" }), label(at + 10, height + 4, "start", words));
  }
  target.setAttribute("viewBox", `0 0 ${W} ${H}`);
  target.setAttribute("aria-label", name);
  target.replaceChildren(...parts);
}

// Horizontal bars of one scale for all, `rows` [[name, value mm, words]].
export function bars(name, rows) {
  const W = innerWidth < 700 ? 340 : 640, row = 34, most = Math.max(1e-6, ...rows.map(([, value]) => value || 0));
  return svg("svg", { viewBox: `0 0 ${W} ${row * rows.length}`, role: "img", "aria-label": `${name}: ${rows.map(([each, , words]) => `${each} ${words}`).join("; ")}`, class: "bars" },
    rows.flatMap(([each, value, words], i) => [
      svg("rect", { x: 0, y: i * row + 17, width: W * 0.8, height: 11, class: "back" }),
      svg("rect", { x: 0, y: i * row + 17, width: Math.max(2, W * 0.8 * (value || 0) / most), height: 11, class: "bar" }),
      svg("text", { x: 0, y: i * row + 12 }, each), svg("text", { x: W, y: i * row + 27, "text-anchor": "end", class: "strong" }, words),
    ]));
}
