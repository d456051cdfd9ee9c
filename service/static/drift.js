"use strict";
// The drift of the reference pose: the distance of its readings from the first one, over time.

let first = {}, drifts = [];
function drifted(event) {
  const data = event.data;
  if (event.kind !== "reading" || data.set !== "reference" || !data.world_mm) return;
  const from = first[data.target] = first[data.target] || data.world_mm;
  drifts.push({ t: event.t_s / 60, off: Math.hypot(...data.world_mm.map((x, i) => x - from[i])), target: data.target });
}

function drawDrift() {
  const svg = $("drift"), W = svg.clientWidth || 480, H = 176, L = 66, B = 26, T = 12;
  const made = (name, values, text) => {
    const node = document.createElementNS("http://www.w3.org/2000/svg", name);
    for (const [k, v] of Object.entries(values)) node.setAttribute(k, v);
    if (text) node.textContent = text;
    return node;
  };
  const label = (x, y, anchor, text, fill = "#5a6675") => made("text", { x, y, "text-anchor": anchor, fill }, text);
  svg.setAttribute("viewBox", `0 0 ${W} ${H}`);
  const most = Math.max(0.01, ...drifts.map((d) => d.off)) * 1.1;
  const t0 = drifts.length ? drifts[0].t : 0, t1 = Math.max(t0 + 1, ...drifts.map((d) => d.t));
  const x = (t) => L + (W - L - 8) * (t - t0) / (t1 - t0), y = (off) => H - B - (H - B - T) * off / most;
  const parts = [
    made("path", { d: `M${L} ${T}V${H - B}H${W - 8}`, fill: "none", stroke: "#8d97a5" }),
    label(L - 6, T + 4, "end", `${number(most)} mm`), label(L - 6, H - B, "end", "0 mm"),
    label(L, H - 8, "start", `${number(t0, 0)} min`), label(W - 8, H - 8, "end", `${number(t1, 0)} min`),
  ];
  const colours = ["#1f6fd0", "#b3541e", "#17633a", "#7a3f98"];
  Object.keys(first).forEach((target, i) => {
    const own = drifts.filter((d) => d.target === target), stroke = colours[i % colours.length];
    parts.push(made("polyline", { points: own.map((d) => `${x(d.t).toFixed(1)},${y(d.off).toFixed(1)}`).join(" "), fill: "none", stroke, "stroke-width": 2 }));
    parts.push(...own.map((d) => made("circle", { cx: x(d.t), cy: y(d.off), r: 2.5, fill: stroke })));
    parts.push(label(L + 10 + 34 * i, T + 4, "start", target, stroke));
  });
  svg.replaceChildren(...parts);
}
