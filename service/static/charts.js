// Strips over time: the drift of the reference pose and the errors of readings, each with its limit and from nought.

import { clock } from "./connection.js";
import { svg } from "./dom.js";
import { number } from "./units.js";
import { t } from "./words.js";

const H = 190, L = 74, B = 30, T = 14, R = 14;
// Series are told apart by the shape of their points as well as by colour.
const LOOKS = [["#1a5fb4", "circle"], ["#9a4a10", "square"], ["#17633a", "diamond"], ["#74398f", "cross"]];

function point(shape, x, y, fill) {
  if (shape === "square") return svg("rect", { x: x - 3, y: y - 3, width: 6, height: 6, fill });
  if (shape === "diamond") return svg("path", { d: `M${x} ${y - 4.5}L${x + 4.5} ${y}L${x} ${y + 4.5}L${x - 4.5} ${y}Z`, fill });
  if (shape === "cross") return svg("path", { d: `M${x - 3.5} ${y - 3.5}l7 7M${x + 3.5} ${y - 3.5}l-7 7`, stroke: fill, "stroke-width": 2 });
  return svg("circle", { cx: x, cy: y, r: 3.2, fill });
}

// A strip of `series` {name: [{utc, y}]}, mm, with one nought and scale for all; `limit` {mm, words} is drawn and said.
export function strip(target, series, { limit, name, joined = true }) {
  const W = Math.max(target.clientWidth || 480, 280), all = Object.values(series).flat();
  const most = Math.max(0.01, limit ? limit.mm * 1.15 : 0, ...all.map((each) => each.y * 1.1));
  const times = all.map((each) => new Date(each.utc).getTime()), first = Math.min(...times), last = Math.max(first + 1000, ...times);
  const x = (utc) => L + (W - L - R) * (new Date(utc).getTime() - first) / (last - first), y = (value) => H - B - (H - B - T) * value / most;
  const label = (at, height, anchor, words, kind = "") => svg("text", { x: at, y: height, "text-anchor": anchor, class: kind }, words);
  const parts = [svg("path", { d: `M${L} ${T}V${H - B}H${W - R}`, class: "axis" }), label(L - 8, T + 5, "end", `${number(most)} mm`), label(L - 8, H - B + 4, "end", "0 mm")];
  if (all.length) parts.push(label(L, H - 9, "start", clock(new Date(first), 5)), label(W - R, H - 9, "end", clock(new Date(last), 5)));
  else parts.push(label((L + W) / 2, H / 2, "middle", t("noneYet")));
  if (limit) {
    parts.push(svg("line", { x1: L, x2: W - R, y1: y(limit.mm), y2: y(limit.mm), class: "limit" }));
    parts.push(label(W - R, y(limit.mm) - 5, "end", limit.words));
  }
  let next = L + 14;
  Object.entries(series).forEach(([each, own], i) => {
    const [colour, shape] = LOOKS[i % LOOKS.length], at = next;
    next += 30 + 7 * each.length;
    const places = own.map((one) => [x(one.utc), y(one.y)]);
    if (joined) parts.push(svg("polyline", { points: places.map((p) => p.map((v) => v.toFixed(1)).join()).join(" "), fill: "none", stroke: colour, "stroke-width": 1.5 }));
    parts.push(...places.map(([a, b]) => point(shape, a, b, colour)), point(shape, at, T, colour), svg("text", { x: at + 8, y: T + 4, fill: colour }, each));
  });
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
