// The view Campaigns: load one or make one, check it with its picture, start it, or go through the whole loop with it.

import { ask, key, reckoned, upload } from "./connection.js";
import { desk, looksOn, moving, order } from "./desk.js";
import { deleting } from "./deleting.js";
import { button, fill, h } from "./dom.js";
import { planPicture } from "./plan.js";
import { moment } from "./units.js";
import { t } from "./words.js";

export function open(root, id) {
  return id ? one(root, id) : all(root);
}

function all(root) {
  const list = h("ul", { className: "list", ariaLabel: t("campaigns") });
  const send = (files) => order(async () => {
    let last = null;
    for (const file of files) {
      const name = file.name.replace(/\.(toml|json)$/i, "");
      if (/\.json$/i.test(file.name)) {
        let campaign;
        try { campaign = JSON.parse(await file.text()); } catch { throw new Error(t("noJson", { name: file.name })); }
        last = await ask("POST", "/campaigns", { campaign, name }, key());
      } else last = await upload("/campaigns/file", { toml: file, name });
    }
    if (last) location.hash = `#/campaigns/${last.id}`;
  });
  const chooser = h("input", { type: "file", accept: ".toml,.json", multiple: true, id: "file", on: { change: () => { send([...chooser.files]); chooser.value = ""; } } });
  const drop = h("div", { className: "drop", on: {
    dragover: (event) => { event.preventDefault(); drop.classList.add("over"); },
    dragleave: () => drop.classList.remove("over"),
    drop: (event) => { event.preventDefault(); drop.classList.remove("over"); send([...event.dataTransfer.files]); },
  } }, h("label", { htmlFor: "file" }, t("chooseFile")), chooser, h("p", { className: "dim" }, t("orDrop")));
  const operator = h("div", {}, h("section", {}, h("h2", {}, t("load")), drop), h("section", {}, h("h2", {}, t("makeOne")), maker()));
  root.append(operator, h("section", { className: "wide" }, h("h2", {}, t("campaigns")), list));
  operator.className = "wide halves";
  const look = async () => {
    const { campaigns } = await ask("GET", "/campaigns");
    operator.hidden = looksOn();
    fill(list, campaigns.map((each) => each.id), () => campaigns.length ? campaigns.map((each) => h("li", {},
      h("a", { href: `#/campaigns/${each.id}`, className: "do" }, each.name || each.id), h("span", { className: "dim" }, moment(new Date(each.created_utc))),
      h("span", {}, blocks(each.campaign)))) : h("li", {}, t("noCampaigns")));
  };
  return { look, show: () => {} };
}

const blocks = (campaign) => (campaign.block || []).map((each) => `${each.kind}${each.count ? ` × ${each.count}` : ""}${each.set ? ` (${each.set})` : ""}`).join(", ");

// The campaign that most cells begin with: so many poses to fit, so many to judge.
function maker() {
  const field = (id, value, low, high) => h("input", { id, type: "number", value, min: low, max: high, required: true, inputMode: "numeric" });
  const fitted = field("fitted", 40, 10, 500), judged = field("judged", 20, 1, 500), warm = field("warm", 0, 0, 1440), name = h("input", { id: "title", maxLength: 200, value: "" });
  return h("form", { className: "form", on: { submit: (event) => {
    event.preventDefault();
    const block = (set, count) => ({ kind: "poses", set, count: Number(count), select: "random" });
    order(async () => {
      const campaign = { format: "truepose-campaign/1", seed: 1, order: "shuffled", approach: { offset_deg: -5.0, sides: "both" }, settle_s: 4.0, samples: 100, retries: 2,
        warm_up_s: 60 * Number(warm.value), reference_every: 25, block: [block("calibration", fitted.value), block("validation", judged.value)] };
      const kept = await ask("POST", "/campaigns", { campaign, name: name.value.trim() }, key());
      location.hash = `#/campaigns/${kept.id}`;
    });
  } } }, h("label", {}, t("name"), name), h("label", {}, t("posesToFit"), fitted), h("label", {}, t("posesToJudge"), judged), h("label", {}, t("warmUpMinutes"), warm), h("button", {}, t("make")));
}

let dried = { campaign: null, run: null };  // the last dry run

function one(root, id) {
  const head = h("h2", {}), what = h("p", {}), picture = planPicture(), verdict = h("p", { id: "verdict", role: "status" }), file = h("details", {});
  const count = h("input", { type: "number", id: "verify", value: 20, min: 1, max: 500, inputMode: "numeric" });
  const plan = h("section", { className: "wide", hidden: true }, h("h2", {}, t("checked")), verdict, picture);
  const begin = (path, more = {}) => order(async () => {
    const made = await ask("POST", path, { campaign_id: id, dry_run: false, name: campaign.name, ...more }, moving());
    location.hash = made.runs ? `#/result/${made.id}` : `#/run/${made.id}`;
  });
  const draw = async () => {
    plan.hidden = false;
    picture.show(await reckoned(`/runs/${dried.run.id}/plan`), await reckoned("/cell/scene"));
    verdict.textContent = t("checkedWell", { readings: dried.run.total });
  };
  const check = button(t("dryRun"), () => order(async () => {
    verdict.textContent = t("checking"); plan.hidden = false;
    try {
      dried = { campaign: id, run: await ask("POST", "/runs", { campaign_id: id, dry_run: true, name: campaign.name }) };
      await draw();
    } catch (error) { verdict.textContent = t("checkedBadly"); picture.clear(); throw error; }
  }), { id: "dry", disabled: true });
  const start = button(t("start"), () => begin("/runs"), { id: "start", className: "go", disabled: true });
  const loop = button(t("startLoop"), () => begin("/loops", { poses: Number(count.value) }), { id: "start-loop", disabled: true });
  const hint = h("p", { className: "dim", id: "why-not" });
  root.append(h("section", { className: "wide" }, head, what, h("div", { className: "row" }, check, start), h("div", { className: "row" }, loop, h("label", {}, t("posesToVerify"), " ", count)),
    h("p", { className: "dim" }, t("loopHint")), hint, file), plan);
  let campaign = { name: "" };
  const show = () => {
    const busy = Boolean(desk.cell && (desk.cell.run_id || desk.cell.loop_id)), free = Boolean(campaign.id) && !busy && Boolean(desk.lease) && !looksOn();
    start.disabled = loop.disabled = !free; check.disabled = looksOn() || !campaign.id;
    fill(hint, [busy, Boolean(desk.lease), looksOn()], () => looksOn() ? t("viewerMayNot") : busy ? t("robotBusy") : desk.lease ? "" : [t("leaseFirst"), " ", h("a", { href: "#/cell" }, t("takeLease"))]);
  };
  const look = async () => {
    if (!campaign.id) {
      campaign = await ask("GET", `/campaigns/${id}`);
      head.textContent = campaign.name || campaign.id;
      what.textContent = blocks(campaign.campaign);
      file.append(h("summary", {}, t("asSent")), h("pre", { tabIndex: 0 }, JSON.stringify(campaign.campaign, null, 2)));
      if (dried.campaign === id) order(draw);
      file.after(deleting(`/campaigns/${id}`, campaign.name || id, "#/campaigns"));
    }
    show();
  };
  return { look, show };
}
