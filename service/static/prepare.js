// Step 1, Prepare: how accurate the robot is to be, or a plan of one's own; and the cell in space.

import { ask, key, reckoned, upload } from "./connection.js";
import { desk, looksOn, order } from "./desk.js";
import { button, card, fill, fold, footBar, h, head, icon, table } from "./dom.js";
import { deletion, menu } from "./menu.js";
import { afresh, road, walk } from "./road.js";
import { scenePicture } from "./scene.js";
import { moment, number } from "./units.js";
import { t } from "./words.js";

const GOAL = { accuracy_mm: 0.1, minutes: 60 };

export const blocks = (campaign) => (campaign.block || []).map((each) => `${each.kind}${each.count ? ` × ${each.count}` : ""}${each.set ? ` (${each.set})` : ""}`).join(", ");

export function open(root) {
  const wish = { ...GOAL, ...road.wish };
  const field = (id, value, low, high, props = {}) => h("input", { id, type: "number", value, min: low, max: high, required: true, inputMode: "numeric", ...props });
  const goal = field("goal", wish.accuracy_mm.toFixed(2), 0.001, 100, { step: "any", inputMode: "decimal" }), minutes = field("minutes", wish.minutes, 1, 100000, { step: "any" });
  const fitted = field("fitted", 40, 10, 500), judged = field("judged", 20, 1, 500), warm = field("warm", 0, 0, 1440), name = h("input", { id: "title", maxLength: 200, value: "" });
  const labelled = (input, words, unit, sub) => h("label", { className: "field" }, h("span", {}, words), unit ? h("span", { className: "with" }, input, h("span", { className: "unit" }, unit)) : input, sub && h("span", { className: "sub" }, sub));
  let fixed = false;
  const how = ["adaptive", "fixed"].map((each) => h("label", { className: "check" }, h("input", { type: "radio", name: "how", id: `how-${each}`, value: each, checked: each === "adaptive", on: { change: () => { fixed = each === "fixed"; shown(); } } }), t(`how_${each}`)));
  const adaptive = h("div", { className: "stack" }, labelled(goal, t("accuracyWanted"), t("mmFor95")), labelled(minutes, t("minutesAtMost"), t("minutesUnit"), t("adaptiveHint")));
  const own = h("div", { className: "stack" }, h("div", { className: "pair" }, labelled(fitted, t("posesToFit")), labelled(judged, t("posesToJudge"))), h("p", { className: "sub" }, t("judgeHint1")), h("div", { className: "pair" }, labelled(warm, t("warmUpMinutes")), labelled(name, t("name"))));
  const form = h("form", { className: "stack", on: { submit: (event) => { event.preventDefault(); next(); } } }, h("fieldset", { className: "stack" }, h("legend", { className: "gone" }, t("goal")), how), adaptive, own, h("button", { className: "gone", tabIndex: -1, ariaHidden: "true" }));
  const shown = () => { adaptive.hidden = fixed; own.hidden = !fixed; for (const each of adaptive.querySelectorAll("input")) each.disabled = fixed; for (const each of own.querySelectorAll("input")) each.disabled = !fixed; };

  const next = () => {
    if (!form.reportValidity()) return;
    if (!fixed) {
      afresh(); walk({ wish: { accuracy_mm: goal.valueAsNumber, minutes: minutes.valueAsNumber } });
      location.hash = "#/check";
      return;
    }
    const block = (set, count) => ({ kind: "poses", set, count: Number(count), select: "random" });
    order(async () => {
      const campaign = { format: "truepose-campaign/1", seed: 1, order: "shuffled", approach: { offset_deg: -5.0, sides: "both" }, settle_s: 4.0, samples: 100, retries: 2,
        warm_up_s: 60 * Number(warm.value), reference_every: 25, block: [block("calibration", fitted.value), block("validation", judged.value)] };
      location.hash = `#/check/${(await ask("POST", "/campaigns", { campaign, name: name.value.trim() }, key())).id}`;
    });
  };

  const send = (files) => order(async () => {
    let last = null;
    for (const file of files) {
      const called = file.name.replace(/\.(toml|json)$/i, "");
      if (/\.json$/i.test(file.name)) {
        let campaign;
        try { campaign = JSON.parse(await file.text()); } catch { throw new Error(t("noJson", { name: file.name })); }
        last = await ask("POST", "/campaigns", { campaign, name: called }, key());
      } else last = await upload("/campaigns/file", { toml: file, name: called });
    }
    if (last) location.hash = `#/check/${last.id}`;
  });
  const chooser = h("input", { type: "file", accept: ".toml,.json", multiple: true, id: "file", on: { change: () => { send([...chooser.files]); chooser.value = ""; } } });
  const drop = h("label", { className: "drop", on: {
    dragover: (event) => { event.preventDefault(); drop.classList.add("over"); },
    dragleave: () => drop.classList.remove("over"),
    drop: (event) => { event.preventDefault(); drop.classList.remove("over"); send([...event.dataTransfer.files]); },
  } }, icon("file"), h("strong", {}, t("chooseFile")), h("span", { className: "sub" }, t("orDrop")), chooser);

  const saved = h("ul", { className: "list", id: "plans", ariaLabel: t("campaigns") }), picture = scenePicture(t("cellPicture")), places = h("div", {}), foot = footBar(t("next"));
  const plan = h("div", { className: "stack" }, card(t("goal"), form), fold(t("earlierPlan"), "", saved, drop));
  root.append(head(t("stepOf", { n: 1 }), h("h1", { id: "title" }, t("prepareTitle")), h("p", { className: "lead" }, t("prepareLead"))),
    h("div", { className: "cols c5-7" }, plan, h("div", { className: "stack" }, card("", picture), fold(t("places"), "", places))), foot);
  shown();

  let scene = null, health = null;
  function show() {
    const { cell } = desk;
    plan.hidden = looksOn() || !cell;
    foot.set([looksOn(), Boolean(cell)], looksOn() ? t("viewerMayNot") : cell ? t("next_prepare") : t("noCell"), () => (looksOn() || !cell ? [] : [button(t("make"), next, { id: "make", kind: "primary", ic: "arrow" })]));
  }
  async function look() {
    if (!health) health = await ask("GET", "/health");
    const { campaigns } = await ask("GET", "/campaigns");
    fill(saved, campaigns.map((each) => each.id), () => campaigns.length ? campaigns.map((each) => h("li", {}, h("a", { href: `#/check/${each.id}`, className: "do" }, each.name || each.id),
      h("span", { className: "sub" }, `${moment(new Date(each.created_utc))} · ${blocks(each.campaign)}`), menu(() => [deletion(`/campaigns/${each.id}`, each.name || each.id)]))) : h("li", {}, t("noCampaigns")));
    if (!scene && desk.cell) {
      scene = await reckoned("/cell/scene");
      picture.show({ ...scene, says: t("cellSays"), described: t("cellDescribed", { boxes: scene.obstacles.length, nests: Object.keys(scene.nests_mm).length }) });
      const coordinates = (p) => p.map((v) => ({ numeric: number(v, 1) })), { cell } = desk;
      places.replaceChildren(table(t("devices"), [t("what"), t("what"), t("driver")], [[t("robot"), cell.robot, cell.robot_driver], [t("instrument"), cell.instrument, cell.instrument_driver], [t("service"), `TruePose ${health.version}`, cell.simulated ? t("simulatedShort") : t("real")]]),
        table(t("places"), [t("place"), "x, mm", "y, mm", "z, mm"], [...Object.entries(scene.nests_mm).map(([each, p]) => [`${t("nest")} ${each}`, ...coordinates(p)]), ...Object.entries(scene.tool_mm).map(([each, p]) => [`${t("target")} ${each} (${t("flangeFrame")})`, ...coordinates(p)])]));
    }
    show();
  }
  return { look, show };
}
