// Step 2, Check: the devices are asked and every path is looked at; nothing moves. From here the robot is started.

import { ask, bearer, reach, reckoned } from "./connection.js";
import { desk, looksOn, moving, order, workOf } from "./desk.js";
import { button, card, fact, fill, fold, footBar, h, head, icon, table } from "./dom.js";
import { control, myName, nameField, openControl, takeControl } from "./lease.js";
import { deletion, menu } from "./menu.js";
import { legend, marks, posesOf } from "./plan.js";
import { blocks } from "./prepare.js";
import { afresh, road, walk } from "./road.js";
import { scenePicture } from "./scene.js";
import { duration, moment, number } from "./units.js";
import { KEYS, t } from "./words.js";

const PATIENCE_MS = 120000, VERIFIED = 20;

const named = (check) => (KEYS.includes(`check_${check}`) ? t(`check_${check}`) : check);
const device = (each) => (KEYS.includes(`device_${each.device}`) ? t(`device_${each.device}`) : each.device);

export function open(root, id) {
  if (!id && !road.wish) { location.hash = "#/prepare"; return { look: async () => {}, show: () => {} }; }
  if (id && road.plan && road.plan.id !== id) afresh();
  const title = h("h1", { id: "title", ariaLive: "polite" }, t("view_of_check")), lead = h("p", { className: "lead" }), picture = scenePicture(t("planPicture")), pictured = card("", picture, legend()), facts = h("dl", { className: "facts big3" }), factsCard = card("", facts);
  const bad = h("div", {}), worth = h("div", {}), good = h("div", {}), file = h("div", {}), foot = footBar(t("next"));
  const seen = h("input", { type: "checkbox", id: "seen" }), who = nameField("starter"), asked = h("label", { className: "field slim" }, h("span", {}, t("yourName")), who);
  const confirm = h("div", { className: "stack", hidden: true }, h("label", { className: "confirm" }, seen, h("span", {}, h("strong", {}, t("lookedIn")), h("span", { className: "sub" }, t("lookedInHint")))), asked);
  const count = h("input", { type: "number", id: "verify", value: VERIFIED, min: 1, max: 500, inputMode: "numeric" });
  const proof = fold(t("moreSettings"), "", h("label", { className: "field" }, h("span", {}, t("posesToVerify")), count), h("p", { className: "sub" }, t("loopHint")));
  const options = menu(() => [!looksOn() && campaign && !busy() && found && found.healthy && { text: t("measureOnly"), id: "measure-only", act: () => begin("/runs") }, campaign && deletion(`/campaigns/${id}`, campaign.name || id, "#/prepare")]);
  root.append(head(t("stepOf", { n: 2 }), title, lead, options), h("div", { className: "cols c5-7" }, h("div", { className: "stack" }, bad, factsCard, worth, good, proof, file), h("div", { className: "stack" }, confirm, pictured)), foot);
  let campaign = null, found = null, plan = null, refused = null, checking = false, lengths = false, ran = false;

  const busy = () => Boolean(desk.cell && (desk.cell.run_id || workOf(desk.cell)));

  // Everything that can be looked at without moving: the devices, then every pose and path.
  async function checkAll() {
    if (checking || looksOn() || busy()) return;
    checking = ran = true; found = refused = null; show();
    try {
      found = await reach("/cell/examination", { method: "POST", headers: bearer() }, PATIENCE_MS, (answer) => answer.json());
      const scene = await reckoned("/cell/scene");
      lengths = Boolean(scene.bar_mm);
      if (id) {
        const dry = road.checked && road.checked.campaign === id ? road.checked.run : await ask("POST", "/runs", { campaign_id: id, dry_run: true, name: campaign.name });
        plan = await reckoned(`/runs/${dry.id}/plan`);
        walk({ checked: { campaign: id, run: dry } });
        picture.show({ ...scene, path_mm: plan.path_mm, marks: marks(plan), says: t("planSays"), described: t("planDescribed", { poses: posesOf(plan).length, boxes: scene.obstacles.length }) });
      } else {
        const { outlook } = await ask("POST", "/loops", { ...road.wish, poses: Number(count.value), dry_run: true });
        walk({ checked: { campaign: "", run: null, outlook } });
        picture.show({ ...scene, says: t("cellSays"), described: t("cellPicture") });
      }
    } catch (error) {
      if (!error.status) throw error;
      refused = error; road.checked = null;
    } finally { checking = false; show(); }
  }

  const begin = (path) => {
    if (!seen.checked) { confirm.querySelector(".confirm").classList.add("miss"); seen.focus(); return; }
    order(async () => {
      if (control() === "nobody") await takeControl(myName(who));
      const what = id ? { campaign_id: id, name: campaign.name } : { ...road.wish };
      const made = await ask("POST", path, { ...what, dry_run: false, ...(path === "/loops" ? { poses: Number(count.value) } : {}) }, moving());
      walk(made.runs ? { run: null, job: null, loop: made } : { run: made, job: null, loop: null });
      location.hash = made.runs ? (made.run_id ? `#/measure/${made.run_id}` : "#/measure") : `#/measure/${made.id}`;
    });
  };
  const path = () => (lengths ? "/runs" : "/loops");
  seen.addEventListener("change", () => confirm.querySelector(".confirm").classList.remove("miss"));

  const line = (ic, kind, what, does) => h("li", { className: `find ${kind}` }, icon(ic), h("div", {}, h("strong", {}, what), does && h("span", { className: "do-it" }, does)));

  function show() {
    const looks = looksOn(), by = control(), faults = (found ? found.findings.filter((each) => each.level === "fault") : []), notes = found ? found.findings.filter((each) => each.level === "note") : [], fine = found ? found.findings.filter((each) => each.level === "ok") : [];
    const n = faults.length + (refused ? 1 : 0), ready = Boolean(found && road.checked && !n), wrong = Boolean(n);
    const says = checking ? t("examining") : wrong ? t("notHealthy", { n }) : ready ? t("healthy") : campaign ? campaign.name || t("fixedPlan") : t("view_of_check");
    if (title.textContent !== says) title.textContent = says;
    lead.textContent = checking ? t("examineHint") : wrong ? t("checkedBadly") : ready ? t("checkedWell") : "";
    fill(bad, [faults, refused && refused.message], () => n ? card(t("toPutRight"), h("ul", { className: "finds" }, faults.map((each) => line("alert", "bad", `${device(each)}: ${each.found}`, each.do)), refused && line("alert", "bad", refused.message, refused.whatToDo))) : []);
    fill(worth, notes, () => notes.length ? card(t("worthKnowing"), h("ul", { className: "finds" }, notes.map((each) => line("info", "note", `${device(each)}, ${named(each.check)}: ${each.found}`, each.do)))) : []);
    fill(good, fine, () => fine.length ? fold(t("goodChecks", { n: fine.length }), t("examinedIn", { s: number(found.seconds, 1) }), table(t("check"), [t("what"), t("check"), t("found")], fine.map((each) => [device(each), named(each.check), each.found]))) : []);
    factsCard.hidden = !(plan || (road.checked && road.checked.outlook)); pictured.hidden = !ready;
    fill(facts, [plan && plan.seconds, road.checked && road.checked.outlook], () => {
      if (plan) {
        const readings = plan.visits.filter((each) => each.seconds !== null).flatMap((each) => each.readings).length;
        return [fact(t("poses"), String(posesOf(plan).length), t("readingsN", { n: readings })), fact(t("time"), duration(plan.seconds), t("doneAt", { at: moment(new Date(Date.now() + 1000 * plan.seconds)) })), fact(t("overHome"), plan.detours === null ? t("notLooked") : String(plan.detours))];
      }
      const o = road.checked && road.checked.outlook;
      if (!o) return [];
      return [fact(t("poses"), o.poses === null ? t("moreThan", { n: o.most }) : t("about", { n: o.poses }), t("readingsEach", { n: o.targets })), o.mountings && fact(t("mountings"), t("about", { n: o.mountings }), t("mountingsHint")), fact(t("time"), t("aboutMin", { n: number(o.minutes, 0) }), t("minutesMost", { n: road.wish.minutes })), fact(t("expected"), `${number(o.limit_mm, 3)} mm`, t("wantedFloor", { mm: number(o.wanted_mm, 2), floor: number(o.floor_mm, 3) }))].filter(Boolean);
    });
    proof.hidden = lengths || looks; asked.hidden = by !== "nobody"; confirm.hidden = !ready || looks || by === "other" || busy();
    options.show();
    foot.set([checking, wrong, ready, looks, by, busy(), path(), ran], checking ? t("examineHint") : looks ? t("viewerMayNot") : busy() ? t("robotBusy") : wrong ? t("putRightFirst", { n }) : !ready ? "" : by === "other" ? t("otherInControl", { name: desk.cell.lease.holder }) : t("next_check"), () => (looks || checking ? []
      : busy() ? [h("a", { className: "btn primary", href: "#/measure" }, t("toRun"))]
        : wrong || !ready ? [button(t(ran ? "checkAgain" : "make"), () => checkAll(), { id: "recheck", kind: "primary", ic: "again" })]
          : by === "other" ? [button(t("takeOverOf", { name: desk.cell.lease.holder }), openControl, { id: "to-control", kind: "primary", ic: "user" })]
            : [button(t("start"), () => begin(path()), { id: "start", kind: "primary", ic: "play" })]));
  }

  async function look() {
    if (id && !campaign) {
      campaign = await ask("GET", `/campaigns/${id}`);
      walk({ plan: { id, name: campaign.name }, wish: null });
      file.append(fold(t("asSent"), blocks(campaign.campaign), h("pre", { tabIndex: 0 }, JSON.stringify(campaign.campaign, null, 2))));
    }
    show();
    if (!ran && !busy()) order(checkAll);
  }
  return { look, show };
}
