// What a run gave: its data sets, what was found in them, and the files of both.

import { asked, limits } from "./acceptance.js";
import { API, ask, key, save } from "./connection.js";
import { deleting } from "./deleting.js";
import { looksOn, order } from "./desk.js";
import { button, fill, h } from "./dom.js";
import { moment, sign, state } from "./units.js";
import { t } from "./words.js";

export const COLLECTIONS = { identification: "identifications", diagnosis: "diagnoses", regression: "regressions", alignment: "alignments" };
const COLLECT_MS = 10000;
const inHand = (job) => ["ready", "running"].includes(job.state);

// A link cannot send a token: the file is fetched with it, and then saved.
export function link(text, path, name) {
  return h("a", { href: API + path, className: "do", on: { click: (event) => { event.preventDefault(); order(() => save(path, name)); } } }, text);
}

export const results = (id) => [link(t("reportFile"), `/reports/${id}`, `${id}-report.html`), link(t("modelFile"), `/models/${id}`, `${id}-model.json`)];

const begin = (text, collection, dataset) => !looksOn() && button(text, () => order(async () => {
  const job = await ask("POST", `/${collection}`, { dataset_id: dataset, ...asked() }, key());
  location.hash = `#/result/${job.id}`;
}));

export function rowOfJob(job) {
  const words = `${sign(job.state)} ${t(`kind_${job.kind}`)} ${moment(new Date(job.created_utc))}: ${state(job.state)}`;
  if (!["identification", "diagnosis"].includes(job.kind)) return [words];
  const at = h("a", { href: `#/result/${job.id}`, className: "do" }, words);
  if (job.problem) return [at, h("span", {}, job.problem.operator_text, " ", job.problem.what_to_do)];
  if (job.state !== "succeeded") return [at];
  const [report, model] = results(job.id);
  return job.result.converged ? [at, h("a", { href: `#/report/${job.id}`, className: "do" }, t("openReport")), report, model] : [at, t("notConverged"), report];
}

export function rowOfDataset(data) {
  return [h("span", {}, t("dataSetOf", { name: data.name, n: data.readings })), link("data.csv", `/datasets/${data.id}/data.csv`, `${data.id}.csv`),
    link("data.toml", `/datasets/${data.id}/data.toml`, `${data.id}.toml`), begin(t("identify"), COLLECTIONS.identification, data.id), begin(t("diagnose"), COLLECTIONS.diagnosis, data.id), deleting(`/datasets/${data.id}`, data.name)];
}

// A section with `look(run)` and `show()`.
export function given() {
  const files = h("ul", { id: "files", className: "list" }), make = button(t("makeData"), () => order(async () => {
    await ask("POST", `/runs/${run.id}/dataset`, {}, key());
    collected.key = "";
    await whole.look(run);
  }), { id: "export" });
  const judged = limits(), gone = h("div", {});
  const whole = h("section", { id: "given", className: "wide", hidden: true }, h("h2", {}, t("gave")), files, judged, h("div", { className: "row" }, make), gone);
  let run = null, found = null, collected = { key: "", at: 0 };
  whole.look = async (of) => {
    run = of;
    if (of.dry_run || !["succeeded", "failed", "paused", "stopped"].includes(of.state)) { found = null; whole.show(); return; }
    const mark = `${of.id} ${of.version}`, known = found && collected.key === mark && Date.now() - collected.at < COLLECT_MS;
    if (known && !found.jobs.some(inHand)) { whole.show(); return; }
    const [{ datasets }, { loops }] = await Promise.all([ask("GET", "/datasets"), ask("GET", "/loops")]);
    const loop = loops.find((each) => each.runs.includes(of.id)) || null;
    const own = datasets.filter((each) => each.run_id === of.id || (loop && each.id === loop.dataset_id));
    const lists = await Promise.all(own.map((each) => ask("GET", `/datasets/${each.id}/jobs`)));
    found = { run: of.id, datasets: own, loop, jobs: lists.flatMap((each) => each.jobs) };
    collected = { key: mark, at: Date.now() };
    whole.show();
  };
  whole.show = () => {
    whole.hidden = !found;
    judged.hidden = looksOn() || !(found && found.datasets.length);
    fill(gone, [found && found.run, looksOn()], () => found && deleting(`/runs/${found.run}`, run.name, "#/run"));
    make.hidden = looksOn() || Boolean(found && found.datasets.length && run.state === "succeeded");
    fill(files, [found, looksOn()], () => (!found ? [] : [
      ...(found.loop && found.loop.report ? [[h("a", { href: `#/result/${found.loop.id}`, className: "do" }, t("loop")), h("a", { href: `#/report/${found.loop.id}`, className: "do" }, t("openReport")), ...results(found.loop.id)]] : []),
      ...found.jobs.map(rowOfJob), ...found.datasets.map(rowOfDataset), [h("span", {}, t("record")), link("events.jsonl", `/runs/${found.run}/events.jsonl`, `${found.run}-events.jsonl`)],
    ]).map((parts) => h("li", {}, parts)));
  };
  return whole;
}
