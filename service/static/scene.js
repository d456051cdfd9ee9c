// A picture of the cell in space that can be turned: robot, boxes, poses, their path, and errors as arrows. Plain SVG,
// so it needs no WebGL. Everything is sorted by depth and painted from behind (Newell's painter's algorithm without
// splitting). Lengths mm, world frame: x to the right, z up when looked at from the front.

import { button, h, svg } from "./dom.js";
import { t } from "./words.js";

const W = 800, H = 560, EDGE = 14, ROOM = 110, TURN = Math.PI / 12, WORDS = 1e9;  // words are painted last
const VIEWS = { oblique: [-0.9, 0.45], front: [-Math.PI / 2, 0], side: [0, 0], top: [-Math.PI / 2, Math.PI / 2] };
const add = (a, b, s = 1) => a.map((x, i) => x + s * b[i]);

// `show(model)`: capsules, obstacles, nests_mm, station_mm as /cell/scene has them; path_mm; marks: [{at, shape, label}];
// arrows: [{at, by}], drawn `enlarged` times.
export function scenePicture(name) {
  let [azimuth, elevation] = VIEWS.oblique, zoom = 1, model = { capsules: [], obstacles: [] }, from = null;
  const drawing = svg("svg", { viewBox: `0 0 ${W} ${H}`, role: "img", "aria-label": name, class: "scene" });
  const says = h("p", { className: "dim scale" });
  const turned = (turn, tilt = 0, closer = 1) => {
    azimuth += turn; elevation = Math.max(-0.3, Math.min(Math.PI / 2, elevation + tilt)); zoom = Math.max(0.4, Math.min(8, zoom * closer));
    draw();
  };
  const tool = (sign, what, act) => button(sign, act, { ariaLabel: t(what), title: t(what) });
  const view = (which) => button(t(`view_${which}`), () => { [azimuth, elevation] = VIEWS[which]; zoom = 1; draw(); });
  const tools = h("div", { className: "row tools", role: "group", ariaLabel: t("turnPicture") },
    tool("⟲", "turnLeft", () => turned(-TURN)), tool("⟳", "turnRight", () => turned(TURN)), tool("▲", "tiltUp", () => turned(0, TURN)),
    tool("▼", "tiltDown", () => turned(0, -TURN)), tool("+", "closer", () => turned(0, 0, 1.3)), tool("−", "farther", () => turned(0, 0, 1 / 1.3)),
    Object.keys(VIEWS).map(view));
  drawing.addEventListener("pointerdown", (event) => { from = [event.clientX, event.clientY]; drawing.setPointerCapture(event.pointerId); });
  drawing.addEventListener("pointermove", (event) => {
    if (!from) return;
    const [x, y] = from;
    from = [event.clientX, event.clientY];
    turned((x - event.clientX) / 120, (event.clientY - y) / 160);
  });
  for (const end of ["pointerup", "pointercancel"]) drawing.addEventListener(end, () => { from = null; });

  // The extent of what is shown, then a projection that holds it: [x, y on the paper, depth towards the eye], and scale.
  function camera() {
    const points = [
      ...(model.capsules || []).flatMap((c) => [c.from_mm, c.to_mm]), ...Object.values(model.nests_mm || {}),
      ...(model.path_mm || []), ...(model.marks || []).map((m) => m.at), ...(model.arrows || []).map((a) => a.at),
      ...(model.obstacles || []).flatMap((o) => (o.kind === "box" ? [o.low_mm, o.high_mm] : o.kind === "post" ? [o.from_mm, o.to_mm] : [])),
    ];
    const ends = [0, 1, 2].map((i) => [Math.min(0, ...points.map((p) => p[i])), Math.max(1, ...points.map((p) => p[i]))]);
    const [ca, sa, ce, se] = [Math.cos(azimuth), Math.sin(azimuth), Math.cos(elevation), Math.sin(elevation)];
    const turn = ([x, y, z]) => {
      const depth = x * ca + y * sa;
      return [-x * sa + y * ca, z * ce - depth * se, depth * ce + z * se];
    };
    const floor = [0, 1, 2, 3].map((i) => [...[0, 1].map((axis) => ends[axis][(i >> axis) & 1]), 0]);
    const [across, up] = [0, 1].map((i) => {
      const seen = [...points, ...floor].map((p) => turn(p)[i]);
      return [Math.min(...seen) - ROOM, Math.max(...seen) + ROOM];
    });
    const scale = zoom * Math.min((W - 2 * EDGE) / (across[1] - across[0]), (H - 2 * EDGE) / (up[1] - up[0]));
    const at = (p) => {
      const [right, high, depth] = turn(p);
      return [W / 2 + scale * (right - (across[0] + across[1]) / 2), H / 2 - scale * (high - (up[0] + up[1]) / 2), depth];
    };
    return { at, scale, ends };
  }

  function draw() {
    const { at, scale, ends } = camera(), parts = [];
    const put = (depth, ...nodes) => parts.push([depth, nodes]);
    const path = (points) => points.map((p) => at(p).slice(0, 2).map((x) => x.toFixed(1)).join(",")).join(" ");
    for (const each of model.obstacles || []) {
      if (each.kind === "table") put(-1e9, ...table(each.z_mm, ends, path));
      else if (each.kind === "box") faces(each.low_mm, each.high_mm).forEach((face) => put(mean(face.map((p) => at(p)[2])), svg("polygon", { points: path(face), class: "box" })));
      else put(mean([at(each.from_mm)[2], at(each.to_mm)[2]]), ...rod(at(each.from_mm), at(each.to_mm), each.radius_mm * scale, "post"));
    }
    for (const each of model.capsules || []) {
      const [a, b] = [at(each.from_mm), at(each.to_mm)];
      put((a[2] + b[2]) / 2, ...rod(a, b, each.radius_mm * scale, each.name.startsWith("the tool") ? "tool" : "arm"));
    }
    for (const [label, place] of Object.entries(model.nests_mm || {})) {
      const [x, y, depth] = at(place);
      put(depth + 1, svg("circle", { cx: x, cy: y, r: 6, class: "nest" }));
      put(WORDS, beside(x, y + 4, 9, label));
    }
    if ((model.path_mm || []).length) put(1e8, svg("polyline", { points: path(model.path_mm), class: "way" }));
    for (const each of model.marks || []) {
      const [x, y, depth] = at(each.at);
      put(1e8 + depth, ...mark(x, y, each));
      if (each.shape === "now") put(WORDS, beside(x, y + 4, 17, each.label || "", "here"));
    }
    for (const each of model.arrows || []) put(at(each.at)[2] + 1e6, ...arrow(at(each.at), at(add(each.at, each.by, model.enlarged || 1))));
    if (model.station_mm) put(WORDS, ...beam(at, model.station_mm, ends));
    parts.sort((a, b) => a[0] - b[0]);
    drawing.replaceChildren(...parts.flatMap(([, nodes]) => nodes));
    says.textContent = model.says || "";
  }

  new ResizeObserver(draw).observe(drawing);  // letters are larger in a narrow window
  const picture = h("figure", { className: "space" }, drawing, says, tools);
  picture.show = (shown) => { model = shown; drawing.setAttribute("aria-label", shown.described || name); draw(); };
  return picture;
}

const mean = (values) => values.reduce((a, b) => a + b, 0) / values.length;

function table(z, ends, path) {
  const [[x0, x1], [y0, y1]] = ends.slice(0, 2).map(([low, high]) => [low - 120, high + 120]);
  const lines = [];
  for (let x = Math.ceil(x0 / 100) * 100; x <= x1; x += 100) lines.push(svg("polyline", { points: path([[x, y0, z], [x, y1, z]]), class: "grid" }));
  for (let y = Math.ceil(y0 / 100) * 100; y <= y1; y += 100) lines.push(svg("polyline", { points: path([[x0, y, z], [x1, y, z]]), class: "grid" }));
  return [svg("polygon", { points: path([[x0, y0, z], [x1, y0, z], [x1, y1, z], [x0, y1, z]]), class: "floor" }), ...lines];
}

function faces(low, high) {
  const corner = (i) => [0, 1, 2].map((axis) => ((i >> axis) & 1 ? high : low)[axis]);
  return [[0, 1, 3, 2], [4, 5, 7, 6], [0, 1, 5, 4], [2, 3, 7, 6], [0, 2, 6, 4], [1, 3, 7, 5]].map((face) => face.map(corner));
}

function rod([x1, y1], [x2, y2], radius, kind) {
  const ends = { x1, y1, x2: x2 + 0.01, y2, "stroke-linecap": "round" };
  return [svg("line", { ...ends, "stroke-width": 2 * radius + 3, class: `${kind} edge` }), svg("line", { ...ends, "stroke-width": 2 * radius, class: kind })];
}

// A measured reading is full, a planned one open, a skipped one a cross, the one in hand has a ring; validation is square.
function mark(x, y, { shape, square }) {
  if (shape === "skipped") return [svg("path", { d: `M${x - 5} ${y - 5}l10 10M${x + 5} ${y - 5}l-10 10`, class: "mark skipped" })];
  const body = square ? svg("rect", { x: x - 4, y: y - 4, width: 8, height: 8, class: `mark ${shape}` }) : svg("circle", { cx: x, cy: y, r: 4.5, class: `mark ${shape}` });
  return shape === "now" ? [svg("circle", { cx: x, cy: y, r: 13, class: "ring" }), body] : [body];
}

// Words to the right of a place; where they would leave the picture to its left, or above it as far right as they may be.
function beside(x, y, away, words, kind = "") {
  const narrow = matchMedia("(max-width: 700px)").matches, wide = (narrow ? 17 : 8.5) * words.length;
  if (x + away + wide <= W) return svg("text", { x: x + away, y, class: kind }, words);
  if (x - away >= wide) return svg("text", { x: x - away, y, "text-anchor": "end", class: kind }, words);
  return svg("text", { x: Math.max(0, W - wide), y: y - (narrow ? 34 : 20), class: kind }, words);
}

function arrow([x1, y1], [x2, y2]) {
  const angle = Math.atan2(y2 - y1, x2 - x1), head = (turn) => `${(x2 - 6 * Math.cos(angle + turn)).toFixed(1)} ${(y2 - 6 * Math.sin(angle + turn)).toFixed(1)}`;
  return [svg("path", { d: `M${x1.toFixed(1)} ${y1.toFixed(1)}L${x2.toFixed(1)} ${y2.toFixed(1)}M${head(0.45)}L${x2.toFixed(1)} ${y2.toFixed(1)}L${head(-0.45)}`, class: "error" })];
}

// The instrument is often metres away: a line towards it, with its distance.
function beam(at, station, ends) {
  const origin = [0, 1, 2].map((i) => (ends[i][0] + ends[i][1]) / 2), to = add(station, origin, -1), far = Math.hypot(...to);
  const reach = Math.min(1, 0.5 * Math.hypot(...ends.map(([low, high]) => high - low)) / far);
  const [x1, y1] = at(add(origin, to, reach * 0.75)), [x2, y2] = at(add(origin, to, reach));
  return [svg("line", { x1, y1, x2, y2, class: "beam" }), beside(x2, Math.min(Math.max(y2 + 5, 16), H - 8), 8, t("stationAway", { m: (far / 1000).toFixed(1) }))];
}
