// The view Result: what a job or a loop has found, with its ladder, effects, errors in space and what it could have seen.

import { acceptance, limits } from "./acceptance.js";
import { ask, key, reckoned, upload } from "./connection.js";
import { deleting } from "./deleting.js";
import { desk, looksOn, order } from "./desk.js";
import { button, fill, h, numeric, table } from "./dom.js";
import { results, rowOfDataset, rowOfJob } from "./given.js";
import { withU } from "./history.js";
import { ladder } from "./ladder.js";
import { exportsOf, programs } from "./programs.js";
import { scenePicture } from "./scene.js";
import { duration, length, moment, number, sign, state } from "./units.js";
import { t } from "./words.js";

const MOST = 40;

export const open = (root, id) => (id ? one(root, id) : all(root));

function all(root) {
  const list = h("ul", { className: "list", ariaLabel: t("results") }), loops = h("ul", { className: "list", ariaLabel: t("loops") });
  const csv = h("input", { type: "file", id: "csv", accept: ".csv", required: true }), toml = h("input", { type: "file", id: "toml", accept: ".toml", required: true });
  const send = h("form", { className: "form", on: { submit: (event) => {
    event.preventDefault();
    order(async () => { await upload("/datasets", { csv: csv.files[0], toml: toml.files[0], name: csv.files[0].name.replace(/\.csv$/i, "") }); send.reset(); });
  } } }, h("label", {}, "DATA.csv", csv), h("label", {}, "DATA.toml", toml), h("button", {}, t("upload")));
  const own = h("section", { className: "wide" }, h("h2", {}, t("ownData")), send, mapped());
  root.append(h("section", { className: "wide" }, h("h2", {}, t("dataSets")), limits(), list), h("section", { className: "wide" }, h("h2", {}, t("loops")), loops), own);
  const look = async () => {
    own.hidden = looksOn();
    const [{ datasets }, found] = await Promise.all([ask("GET", "/datasets"), ask("GET", "/loops")]);
    const sets = await Promise.all(datasets.slice(0, MOST).map(async (data) => [data, (await ask("GET", `/datasets/${data.id}/jobs`)).jobs]));
    fill(list, [sets.map(([data, jobs]) => [data.id, jobs.map((job) => [job.id, job.state])]), looksOn()], () => sets.length ? sets.flatMap(([data, jobs]) => [
      h("li", { className: "head" }, rowOfDataset(data)), ...jobs.map((job) => h("li", { className: "under" }, rowOfJob(job)))]) : h("li", {}, t("noDataSets")));
    fill(loops, found.loops.map((each) => [each.id, each.state]), () => found.loops.length ? found.loops.map((each) => h("li", {},
      h("a", { href: `#/result/${each.id}`, className: "do" }, `${sign(each.state)} ${each.name} ${moment(new Date(each.created_utc))}: ${state(each.state)}`))) : h("li", {}, t("noLoops")));
  };
  return { look, show: () => {} };
}

// Files of another program and the map of their columns.
function mapped() {
  const files = h("input", { type: "file", id: "foreign", multiple: true, required: true }), map = h("input", { type: "file", id: "map", accept: ".toml", required: true }), told = h("div", { id: "mapped", role: "status" });
  const send = h("form", { className: "form", on: { submit: (event) => {
    event.preventDefault();
    order(async () => {
      told.replaceChildren();
      const made = await upload("/datasets/mapped", { files: [...files.files], map: map.files[0], name: files.files[0].name.replace(/\.\w+$/, "") });
      const fit = made.fit_of_robot;
      told.replaceChildren(h("p", {}, t("mappedTo", { name: made.name, n: made.readings }), fit ? ` ${t("mappedFit", { robot: fit.robot, mm: number(fit.miss_mm) })}` : ""),
        h("ul", {}, made.said.map((each) => h("li", {}, each))));
      send.reset();
    });
  } } }, h("label", {}, t("foreignFiles"), files), h("label", {}, "MAP.toml", map), h("button", {}, t("upload")));
  return h("div", { className: "also" }, h("h3", {}, t("otherProgram")), h("p", { className: "dim" }, t("otherProgramHint")), send, told);
}

function one(root, id) {
  const head = h("h2", {}), says = h("p", { className: "big", id: "job", role: "status" }), step = h("p", { id: "step" }), bar = h("progress", { ariaLabel: t("working"), hidden: true }), steps = h("ol", {});
  const files = h("div", { className: "row" }), body = h("div", { className: "views wide" }), picture = scenePicture(t("arrowPicture"));
  root.append(h("section", { className: "wide" }, head, says, step, bar, steps, files), body);
  let job = null, drawn = false;

  const orders = (verb) => button(t(verb), () => order(() => ask("POST", `/loops/${id}/${verb}`, verb === "resume" ? {} : undefined, { ...(desk.lease ? { "Lease-Id": desk.lease.lease_id } : {}), ...key() })), { id: `loop-${verb}` });

  function show() {
    if (!job) return;
    const busy = ["ready", "running", "waiting_for_operator", "paused"].includes(job.state), since = (Date.now() - new Date(job.created_utc)) / 1000;
    head.textContent = [t(`kind_${job.kind}`), job.name, moment(new Date(job.created_utc))].filter(Boolean).join(" · ");
    says.textContent = `${sign(job.state)} ${state(job.state)}`;
    step.textContent = busy ? [job.step || (job.state === "ready" ? t("waitsForTurn") : ""), t("sinceThen", { time: duration(since) })].filter(Boolean).join(" · ") : job.reason || "";
    bar.hidden = !busy || job.state === "paused";
    fill(steps, job.steps || [], () => (job.steps || []).map((each) => h("li", {}, each)));
    fill(files, [job.state, Boolean(job.report), looksOn(), job.run_id, Boolean(desk.lease)], () => [
      ...(job.run_id ? [job.run_id] : job.runs || []).map((each) => h("a", { href: `#/run/${each}`, className: "do" }, `${t("toRun")} ${each.split("-").slice(3).join(" ")}`)),
      ...(job.kind === "loop" && busy && !looksOn() ? [orders("pause"), job.state === "paused" && orders("resume")] : []),
      ...(job.report ? [h("a", { href: `#/report/${id}`, className: "do" }, t("openReport")), ...results(id)] : [])]);
    fill(body, [job.state, looksOn()], () => (job.problem ? [h("section", { className: "wide bad" }, h("p", {}, h("strong", {}, "✖ ", job.problem.operator_text)), h("p", {}, `${t("whatToDo")} `, job.problem.what_to_do))] : job.result && ["identification", "diagnosis", "loop"].includes(job.kind) ? findings() : [])
      .concat(job.kind !== "loop" && !busy && !looksOn() ? [h("section", { className: "wide" }, deleting(`/results/${id}`, head.textContent, "#/result"))] : []));
  }

  function findings() {
    const r = job.result, wide = { className: "wide" };
    const whole = [h("section", wide, h("h2", {}, t("ladder")), r.verdict && h("p", { className: "big" }, `${t("verdict")}: ${t(`verdict_${r.verdict}`)}`), r.finding && h("p", {}, r.finding), acceptance(r.acceptance), ladder(job), h("p", { className: "dim" }, t("ladderHint")))];
    if (r.effects) whole.push(h("section", wide, h("h2", {}, t("effects")), r.effects.some((each) => each.imitates) ? h("p", {}, t("imitatedBy")) : null, r.effects.length ? r.effects.map(effect) : h("p", {}, t("noEffects"))));
    if ((r.carried || []).length) whole.push(h("section", wide, h("h2", {}, t("carriedTerms")), h("ul", {}, r.carried.filter((each) => each.confirmed).map((each) => h("li", {}, each.finding)))));
    if ((r.next_measurements || []).length) whole.push(h("section", wide, h("h2", {}, t("whatToDo")), h("ol", {}, r.next_measurements.map((each) => h("li", {}, each)))));
    whole.push(h("section", wide, h("h2", {}, t("arrowPicture")), picture));
    if ((r.power || []).length) whole.push(h("section", wide, h("details", {}, h("summary", {}, t("power")), h("p", { className: "dim" }, t("powerHint")),
      powerTable(r.power))));
    const remarks = [...(r.warnings || []), ...(r.notes || [])];
    if (remarks.length) whole.push(h("section", wide, h("h2", {}, t("notes")), h("ul", {}, remarks.map((each) => h("li", {}, each)))));
    if (!looksOn() && r.converged !== false) whole.push(programs(id), ...exportsOf(id, job.kind !== "loop"));
    const next = (r.follow_up || []).filter((each) => each.campaign);
    if (next.length && !looksOn()) whole.push(h("section", wide, h("h2", {}, t("followUp")), h("p", {}, t("followUpHint")), next.map((each) => button(t("keepCampaign"), () => order(async () => {
      const kept = await ask("POST", "/campaigns", { campaign: each.campaign, name: `follow-up of ${id}` }, key());
      location.hash = `#/campaigns/${kept.id}`;
    })))));
    return whole;
  }

  async function draw() {
    drawn = true;
    const [found, scene] = [await reckoned(`/results/${id}/arrows`), await reckoned("/cell/scene").catch(() => ({ capsules: [], obstacles: [] }))];
    if (!found.arrows.length) { picture.replaceWith(h("p", {}, t("noArrows"))); return; }
    let which = "nominal_mm";
    const both = () => {
      const most = Math.max(...found.arrows.map((each) => length(each[which]))), enlarged = 10 ** Math.round(Math.log10(90 / most));
      picture.show({ ...scene, arrows: found.arrows.map((each) => ({ at: each.at_mm, by: each[which] })), enlarged,
        says: t("arrowScale", { n: found.arrows.length, of: found.readings, times: enlarged, mm: number(most) }), described: t(which === "nominal_mm" ? "arrowsBefore" : "arrowsAfter", { mm: number(most) }) });
    };
    const choice = (value, words) => h("label", { className: "check" }, h("input", { type: "radio", name: "which", value, checked: value === which, on: { change: () => { which = value; both(); } } }), words);
    picture.before(h("fieldset", { className: "row" }, h("legend", {}, t("errorsOf")), choice("nominal_mm", t("rungNominal")), choice("model_mm", t("withModel"))));
    both();
  }

  const look = async () => {
    if (!job || ["ready", "running", "waiting_for_operator", "paused"].includes(job.state)) job = await ask("GET", `/results/${id}`);
    show();
    if (!drawn && job.result && picture.isConnected) await draw().catch((error) => { if (error.status === 404) picture.replaceWith(h("p", {}, t("noArrows"))); else { drawn = false; throw error; } });
  };
  return { look, show };
}

// One row a kind of effect, one column a joint; what acts on no joint stands in the first.
function powerTable(power) {
  const kinds = new Map(), joints = new Set();
  for (const { label, smallest, unit } of power) {
    const [kind, , joint] = label.match(/^(.*?)(:j(\d+))?$/).slice(1), key = `${kind}, ${unit}`;
    if (joint) joints.add(Number(joint));
    if (!kinds.has(key)) kinds.set(key, {});
    kinds.get(key)[joint || ""] = smallest === null ? t("notSeen") : number(smallest, smallest >= 100 ? 0 : 3);
  }
  const columns = [...joints].sort((a, b) => a - b), some = [...kinds.values()].some((row) => row[""] !== undefined);
  return table(t("power"), [t("effect"), ...(some ? [t("noJoint")] : []), ...columns.map((joint) => `${t("joint")} ${joint}`)],
    [...kinds].map(([key, row]) => [key, ...(some ? [""] : []), ...columns].map((joint, i) => (i ? numeric(row[joint] ?? "") : joint))));
}

function effect(each) {
  const { value, std, unit } = each.amplitude || {};
  const rivals = Object.entries(each.candidates || {}).filter(([label]) => label !== each.label);
  return h("article", { className: "effect" }, h("h3", {}, each.label), h("p", {}, each.meaning),
    h("p", {}, `${t("size")}: ${withU(value, 2 * std, unit || "")} (U, k = 2); ${t("explains", { percent: number(100 * (each.evidence.explained_variance || 0), 0) })}`),
    rivals.length && !each.imitates ? h("p", {}, `${t("orElse")}: ${rivals.map(([label, weight]) => `${label} (${number(100 * weight, 0)} %)`).join(", ")}`) : null,
    each.check && h("p", {}, `${t("checkIt")}: `, typeof each.check === "string" ? each.check : each.check.text || ""));
}
