// Charts by uPlot: points and lines over a number or over time, with limits, hover and a click; and bars in HTML.

import { h } from "./dom.js";
import uPlot from "./vendor/uPlot.esm.js";
import { number } from "./units.js";

const NEAR_PX = 22, FONT = "13px system-ui, sans-serif";
const token = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();

// A point shape besides a circle, since colour alone tells nothing.
function squares(u, i) {
  const path = new Path2D(), side = 7 * devicePixelRatio, [xs, ys] = [u.data[0], u.data[i]];
  xs.forEach((x, k) => { if (ys[k] !== null && ys[k] !== undefined) path.rect(u.valToPos(x, "x", true) - side / 2, u.valToPos(ys[k], "y", true) - side / 2, side, side); });
  return { fill: path, stroke: path };
}

// Upright bars of ±u around the values of the first series.
function whiskers(u, points) {
  u.ctx.save();
  u.ctx.strokeStyle = token("mark"); u.ctx.lineWidth = 1.5 * devicePixelRatio;
  for (const each of points) if (each.u) {
    const x = u.valToPos(each.x, "x", true);
    u.ctx.beginPath(); u.ctx.moveTo(x, u.valToPos(each.y - each.u, "y", true)); u.ctx.lineTo(x, u.valToPos(each.y + each.u, "y", true)); u.ctx.stroke();
  }
  u.ctx.restore();
}

// The ends of the axis of x: with room beside the points, or from `from` where there is one, which a lone point needs to be read.
export function spread(xs, { time, from } = {}) {
  if (!xs.length) return [from ?? 0, (from ?? 0) + 1];
  const first = Math.min(...xs), last = Math.max(...xs), start = Math.min(from ?? first, first), side = 0.03 * (last - start) || (time ? 60 : 1);
  return [from === undefined ? first - side : start, last + side];
}

// A figure with `set(spec)`: {series: [{name, points: [{x, y, u, id, tip}], kind: line | dash | steps | dots | squares, colour}], limit: {y, words},
// x: {time, from}, y: {from}, chosen, says}. `pick(id)`: a point was clicked; `bare`: without the axis of x.
export function chart(name, { pick = null, height = 210, className = "", bare = false } = {}) {
  const place = h("div", { className: "chart", role: "img", ariaLabel: name }), tip = h("div", { className: "tip", hidden: true }), key = h("ul", { className: "key" }), figure = h("figure", { className: `plot ${className}` }, key, h("div", { className: "stage" }, place, tip));
  let spec = { series: [] }, plot = null;

  function draw() {
    const width = Math.max(200, place.clientWidth || 0);
    if (!place.clientWidth || !figure.isConnected) return;
    if (plot) plot.destroy();
    place.replaceChildren();
    const { series, limit, x = {}, y = {} } = spec, all = series.flatMap((each) => each.points), ink = token("ink-3"), rule = token("line");
    const tables = series.map((each) => [each.points.map((p) => p.x), each.points.map((p) => p.y)]);
    const data = tables.length > 1 ? uPlot.join(tables) : tables[0] || [[], []];
    const tops = all.flatMap((p) => [p.y - (p.u || 0), p.y + (p.u || 0)]).concat(limit ? [limit.y] : []), high = Math.max(...tops, y.from === 0 ? 0.01 : -Infinity), low = y.from === 0 ? 0 : Math.min(...tops), room = 0.08 * (high - low || Math.abs(high) || 1);
    const axis = { stroke: ink, font: FONT, grid: { stroke: rule, width: 1 }, ticks: { stroke: rule } };
    plot = new uPlot({
      width, height, legend: { show: false }, padding: [12, 12, 0, 0],
      cursor: { y: false, drag: { x: false, y: false }, points: { show: false } },
      scales: { x: { time: Boolean(x.time), range: spread(all.map((p) => p.x), x) }, y: { range: tops.length ? [y.from === 0 ? 0 : low - room, high + room] : [0, 1] } },
      axes: [{ ...axis, show: !bare, size: 32, space: 70, ...(x.time ? { values: x.time } : {}) }, { ...axis, size: 58, space: 38 }],
      series: [{}, ...series.map(({ kind = "line", colour = "before" }) => {
        const stroke = token(colour), points = { show: kind === "dots" || kind === "line", size: kind === "line" ? 4 : 7, fill: stroke, stroke };
        return kind === "squares" ? { stroke, fill: stroke, paths: squares, points: { show: false } }
          : { stroke, width: kind === "steps" || kind === "dash" ? 1.5 : 2, dash: ["dash", "steps"].includes(kind) ? [4, 5] : undefined, spanGaps: kind !== "dots", points,
            paths: kind === "dots" ? () => null : kind === "steps" ? uPlot.paths.stepped({ align: 1 }) : undefined };
      })],
      hooks: {
        draw: [(u) => {
          if (series[0]) whiskers(u, series[0].points);
          const ratio = devicePixelRatio;
          if (limit) {
            const at = u.valToPos(limit.y, "y", true);
            u.ctx.save(); u.ctx.strokeStyle = token("ink"); u.ctx.setLineDash([7 * ratio, 4 * ratio]); u.ctx.lineWidth = 1.4 * ratio;
            u.ctx.beginPath(); u.ctx.moveTo(u.bbox.left, at); u.ctx.lineTo(u.bbox.left + u.bbox.width, at); u.ctx.stroke(); u.ctx.restore();
          }
          for (const p of all) if (p.signal || (p.id !== undefined && p.id === spec.chosen)) {
            u.ctx.save(); u.ctx.strokeStyle = token(p.signal ? "stop-text" : "ink"); u.ctx.lineWidth = 3 * ratio;
            u.ctx.beginPath(); u.ctx.arc(u.valToPos(p.x, "x", true), u.valToPos(p.y, "y", true), 9 * ratio, 0, 2 * Math.PI); u.ctx.stroke(); u.ctx.restore();
          }
        }],
      },
    }, data, place);
  }

  function nearest(event) {
    if (!plot) return null;
    const at = plot.over.getBoundingClientRect(), [x, y] = [event.clientX - at.left, event.clientY - at.top];
    let best = null, least = NEAR_PX;
    for (const each of spec.series.flatMap((one) => one.points)) {
      const away = Math.hypot(plot.valToPos(each.x, "x") - x, plot.valToPos(each.y, "y") - y);
      if (away < least) { least = away; best = each; }
    }
    return best;
  }

  place.addEventListener("pointermove", (event) => {
    const found = nearest(event), at = place.getBoundingClientRect();
    tip.hidden = !found; place.classList.toggle("over", Boolean(found && pick));
    if (found) { tip.textContent = found.tip || number(found.y); tip.style.left = `${Math.max(4, Math.min(event.clientX - at.left + 12, at.width - 190))}px`; tip.style.top = `${Math.max(0, event.clientY - at.top - 44)}px`; }
  });
  place.addEventListener("pointerleave", () => { tip.hidden = true; });
  place.addEventListener("click", (event) => { const found = pick && nearest(event); if (found && found.id !== undefined) pick(found.id); });
  new ResizeObserver(draw).observe(place);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", draw);
  figure.set = (shown) => {
    spec = shown;
    figure.dataset.points = String(shown.series.reduce((sum, each) => sum + each.points.length, 0));
    place.setAttribute("aria-label", shown.says || name);
    const entry = (kind, colour, words) => h("li", { className: `${kind} ${colour}` }, words);
    key.replaceChildren(...shown.series.filter((each) => each.name).map((each) => entry(each.kind || "line", each.colour || "before", each.name)), ...(shown.limit ? [entry("dash", "limit", shown.limit.words)] : []));
    place.style.height = `${height}px`;
    draw();
  };
  return figure;
}

// Horizontal bars of one scale for all, `rows` [[name, value mm, words, class]].
export function bars(name, rows) {
  const most = Math.max(1e-6, ...rows.map(([, value]) => value || 0));
  return h("ol", { className: "ladder", ariaLabel: name }, rows.map(([each, value, words, kind]) => {
    const bar = h("i", { className: kind });
    bar.style.width = `${Math.max(0.6, 100 * (value || 0) / most)}%`;
    return h("li", {}, h("span", { className: "name" }, each), h("span", { className: "track" }, bar), h("span", { className: "val" }, words));
  }));
}
