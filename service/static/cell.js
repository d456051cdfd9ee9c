// The view Cell: what stands there, who may move it, and what it does now.

import { ask, reckoned } from "./connection.js";
import { desk, order, reasonOf, resting } from "./desk.js";
import { trail } from "./deleting.js";
import { fill, h, table } from "./dom.js";
import { examination } from "./examination.js";
import { leasePanel } from "./lease.js";
import { scenePicture } from "./scene.js";
import { number, sign, state } from "./units.js";
import { t } from "./words.js";

export function open(root) {
  const lease = leasePanel(), facts = h("section", {}, h("h2", {}, t("devices"))), body = h("div", {}), now = h("div", {});
  const examined = examination(), deleted = trail(), picture = scenePicture(t("cellPicture")), lists = h("div", {});
  facts.append(body);
  root.append(h("section", {}, h("h2", {}, t("nowHere")), now), lease, facts,
    examined, h("section", { className: "wide" }, h("h2", {}, t("cellPicture")), picture, lists), h("section", { className: "wide" }, deleted));
  let scene = null, health = null;

  function show() {
    const { cell, busy, loop } = desk, rests = loop ? null : resting(), named = (run) => h("a", { href: `#/run/${run.id}` }, `${sign(run.state)} ${run.name}: ${state(run.state)}`);
    if (!cell) return;
    lease.show(); examined.show();
    fill(now, [busy && busy.id, busy && busy.state, loop && loop.step, loop && loop.id, rests && [rests.id, rests.version, rests.state, rests.reason]], () => [
      busy ? h("p", { className: "big" }, named(busy)) : h("p", { className: "big" }, loop ? t("loopBetween") : rests ? named(rests) : t("nothingRuns")),
      rests && h("p", {}, reasonOf(rests, cell)),
      loop && h("p", {}, `${t("loop")}: ${loop.step}`),
      !busy && h("p", {}, h("a", { href: "#/campaigns", className: "do" }, t("toCampaigns"))),
    ]);
    fill(body, [cell, health], () => table(t("devices"), ["", t("what"), t("driver")], [
      [t("robot"), cell.robot, cell.robot_driver], [t("instrument"), cell.instrument, cell.instrument_driver],
      [t("targets"), cell.targets.join(", "), ""], [t("nests"), cell.nests.join(", "), ""],
      [t("service"), health ? `TruePose ${health.version}` : "–", cell.simulated ? t("simulatedShort") : t("real")],
    ]));
  }

  async function look() {
    if (!health) health = await ask("GET", "/health");
    if (!scene) {
      scene = await reckoned("/cell/scene");
      picture.show({ ...scene, described: t("cellDescribed", { boxes: scene.obstacles.length, nests: Object.keys(scene.nests_mm).length }) });
      fill(lists, scene, () => table(t("places"), ["", "x, mm", "y, mm", "z, mm"], [
        ...Object.entries(scene.nests_mm).map(([name, p]) => [`${t("nest")} ${name}`, ...p.map((v) => ({ numeric: number(v, 1) }))]),
        ...Object.entries(scene.tool_mm).map(([name, p]) => [`${t("target")} ${name} (${t("flangeFrame")})`, ...p.map((v) => ({ numeric: number(v, 1) }))]),
      ]));
    }
    show();
  }
  return { look: () => look().catch((error) => { if (error.status !== 404) throw error; }), show, order };
}
