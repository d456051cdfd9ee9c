// The picture beside a prompt, drawn from the cell: which nest, which ball, which bar. The prompt names it in `picture`:
// seat/NAME, aim/NAME, moved/NAME, off, span/BASE/TOOL, calibrator; words alone: drive, pendant, read/TARGET, and behind each of
// these again/REASON/NAME, where what was typed cannot be right.

import { svg } from "./dom.js";
import { t } from "./words.js";

const W = 360, H = 230;

// The prompt in few words; null where only the service has words for it.
export function promptWords(prompt) {
  const [asked, again] = (prompt.picture || "").split("/again/"), [what, one, other] = asked.split("/");
  if (!what) return null;
  const [reason, name] = (again || "").split("/");
  return [again ? t(`slip_${reason}`, { one: name || "" }) : "", t(`prompt_${what}`, { one, other })].filter(Boolean).join(" ");
}

export function promptPicture(prompt, scene) {
  const [what, one, other] = (prompt.picture || "").split("/");
  if (!what || !scene || prompt.entry) return null;
  const parts = what === "span" ? span(scene, one, other) : what === "off" ? off() : what === "calibrator" ? calibrator() : seat(scene, one, what === "aim");
  return svg("svg", { viewBox: `0 0 ${W} ${H}`, role: "img", "aria-label": promptWords(prompt), class: "prompt-picture" }, parts);
}

const label = (x, y, text, strong) => svg("text", { x, y, "text-anchor": "middle", class: strong ? "strong" : "" }, text);

// A map of places [x, y] that fills a box of the paper.
function map(places, [x0, y0, x1, y1]) {
  const ends = [0, 1].map((i) => [Math.min(...places.map((p) => p[i])), Math.max(...places.map((p) => p[i]))]);
  const scale = Math.min((x1 - x0) / Math.max(1, ends[0][1] - ends[0][0]), (y1 - y0) / Math.max(1, ends[1][1] - ends[1][0]));
  const middle = ends.map(([low, high]) => (low + high) / 2);
  return (p) => [(x0 + x1) / 2 + scale * (p[0] - middle[0]), (y0 + y1) / 2 - scale * (p[1] - middle[1])];
}

function smr(x, y, r = 15) {
  return [svg("path", { d: `M${x - r - 7} ${y + 3}q${r + 7} ${r + 16} ${2 * (r + 7)} 0z`, class: "cup" }), svg("circle", { cx: x, cy: y - 3, r, class: "ball" }),
    svg("path", { d: `M${x} ${y - 3}l-7 -9M${x} ${y - 3}l8 -7M${x} ${y - 3}l1 10`, class: "corner" })];
}

// Nests on the table from above, the robot's foot between them; targets of the tool as the flange shows them.
function seat(scene, name, aimed) {
  const nests = Object.entries(scene.nests_mm).map(([each, p]) => [each, p]), onTool = !scene.nests_mm[name];
  const places = onTool ? Object.entries(scene.tool_mm).map(([each, p]) => [each, [p[1], p[0]]]) : nests;
  const at = map([...places.map(([, p]) => p), [0, 0]], [70, 60, W - 70, H - 60]), [fx, fy] = at([0, 0]);
  const body = onTool ? [svg("circle", { cx: fx, cy: fy, r: 26, class: "flange" }), label(fx, fy + 45, t("flange")),
    ...places.map(([, p]) => { const [x, y] = at(p); return svg("line", { x1: fx, y1: fy, x2: x, y2: y, class: "bracket" }); })]
    : [svg("rect", { x: 8, y: 8, width: W - 16, height: H - 16, rx: 8, class: "floor" }), svg("circle", { cx: fx, cy: fy, r: 30, class: "flange" }), label(fx, fy + 48, t("foot"))];
  return [...body, ...places.flatMap(([each, p]) => {
    const [x, y] = at(p), here = each === name;
    return [here ? svg("circle", { cx: x, cy: y, r: 31, class: "ring" }) : svg("circle", { cx: x, cy: y, r: 9, class: "empty" }),
      ...(here ? smr(x, y) : []), label(x, y - (here ? 37 : 15), each, here),
      ...(here && aimed ? [svg("line", { x1: W - 6, y1: 8, x2: x + 14, y2: y - 12, class: "beam" })] : [])];
  })];
}

function bar(x1, y1, x2, y2) {
  const part = (a, b) => ({ x1: x1 + a * (x2 - x1), y1: y1 + a * (y2 - y1), x2: x1 + b * (x2 - x1), y2: y1 + b * (y2 - y1) });
  return [svg("line", { ...part(0, 1), class: "rod" }), svg("line", { ...part(0.28, 0.62), class: "body" })];
}

function span(scene, one, other) {
  const row = (names, y) => names.map((each, i) => [each, [(W * (i + 1)) / (names.length + 1), y]]);
  const places = [...row(Object.keys(scene.tool_mm), 58), ...row(Object.keys(scene.nests_mm), H - 58)], of = Object.fromEntries(places);
  const [a, b] = [of[one], of[other]];
  return [svg("rect", { x: 24, y: 8, width: W - 48, height: 30, rx: 6, class: "flange" }), label(W / 2, 28, t("tool")),
    svg("rect", { x: 24, y: H - 36, width: W - 48, height: 28, rx: 6, class: "floor" }), label(W / 2, H - 17, t("base")),
    ...(a && b ? bar(...a, ...b) : []),
    ...places.flatMap(([each, [x, y]]) => {
      const here = each === one || each === other;
      return [...(here ? [svg("circle", { cx: x, cy: y, r: 22, class: "ring" })] : []), svg("circle", { cx: x, cy: y, r: here ? 11 : 7, class: here ? "ball" : "empty" }),
        label(x, y < H / 2 ? y + (here ? 40 : 26) : y - (here ? 30 : 16), each, here)];
    })];
}

function off() {
  return [svg("circle", { cx: 110, cy: 110, r: 40, class: "flange" }), label(110, 115, t("tool")), ...bar(190, 175, 330, 175),
    svg("path", { d: "M150 130q30 20 50 30M200 160l-14 -1M200 160l-6 -12", class: "motion" }), label(260, 205, t("bar"), true)];
}

function calibrator() {
  return [svg("rect", { x: 40, y: 140, width: W - 80, height: 34, rx: 6, class: "floor" }), label(W / 2, 196, t("calibratorName"), true),
    svg("rect", { x: 66, y: 92, width: 22, height: 50, class: "flange" }), svg("rect", { x: W - 88, y: 92, width: 22, height: 50, class: "flange" }), ...bar(77, 86, W - 77, 86),
    svg("circle", { cx: 77, cy: 86, r: 11, class: "ball" }), svg("circle", { cx: W - 77, cy: 86, r: 11, class: "ball" })];
}
