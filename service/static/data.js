// Data and results: every data set with what was found in it, loops, files of one's own, and what was deleted.

import { asked } from "./acceptance.js";
import { API, ask, key, save, upload } from "./connection.js";
import { looksOn, order } from "./desk.js";
import { button, card, fill, fold, h, head, table } from "./dom.js";
import { errorsOf } from "./ladder.js";
import { deletion, menu } from "./menu.js";
import { moment, number, sign, state } from "./units.js";
import { t } from "./words.js";

const MOST = 40;

// A link cannot send a token: the file is fetched with it, and then saved.
export const link = (text, path, name) => h("a", { href: API + path, className: "do", on: { click: (event) => { event.preventDefault(); order(() => save(path, name)); } } }, text);

// The last error of a result, as the list says it: from what to what.
export function outcome(job) {
  if (job.problem) return job.problem.operator_text;
  if (!job.result) return state(job.state);
  if (job.result.converged === false) return t("notConverged");
  const { first, last } = errorsOf(job);
  return [job.result.verdict ? t(`said_${job.result.verdict}`) : "", first !== null ? `${number(first, 2)} → ${number(last, 2)} mm` : ""].filter(Boolean).join(", ") || state(job.state);
}

const inHand = (job) => ["ready", "running"].includes(job.state);
const begin = (kind, dataset) => order(async () => { location.hash = `#/diagnose/${(await ask("POST", `/${kind}`, { dataset_id: dataset, ...asked() }, key())).id}`; });

function rowOfJob(job) {
  const words = `${sign(job.state)} ${t(`kind_${job.kind}`)} ${moment(new Date(job.created_utc))}`;
  return h("li", { className: "under" }, ["identification", "diagnosis"].includes(job.kind) ? h("a", { href: `#/diagnose/${job.id}`, className: "do" }, words) : words, h("span", { className: "sub" }, outcome(job)));
}

function rowOfDataset(data) {
  const file = (ending) => ({ text: t("saveFile", { name: `data.${ending}` }), act: () => order(() => save(`/datasets/${data.id}/data.${ending}`, `${data.id}.${ending}`)) });
  return h("li", { className: "head-row", "data-id": data.id }, h("span", {}, h("strong", {}, data.name), h("span", { className: "sub" }, ` ${t("readingsN", { n: data.readings })}, ${moment(new Date(data.created_utc))}`)),
    h("span", { className: "row" }, looksOn() ? null : button(t("diagnose"), () => begin("diagnoses", data.id)), menu(() => [file("csv"), file("toml"), !looksOn() && { text: t("identify"), act: () => begin("identifications", data.id) }, data.run_id && { text: t("toRun"), act: () => { location.hash = `#/measure/${data.run_id}`; } }, deletion(`/datasets/${data.id}`, data.name)])));
}

export function open(root) {
  const list = h("ul", { className: "list", id: "datasets", ariaLabel: t("dataSets") }), loops = h("ul", { className: "list", ariaLabel: t("loops") });
  const csv = h("input", { type: "file", id: "csv", accept: ".csv", required: true }), toml = h("input", { type: "file", id: "toml", accept: ".toml", required: true });
  const send = h("form", { className: "form", on: { submit: (event) => {
    event.preventDefault();
    order(async () => { await upload("/datasets", { csv: csv.files[0], toml: toml.files[0], name: csv.files[0].name.replace(/\.csv$/i, "") }); send.reset(); });
  } } }, h("label", { className: "field" }, h("span", {}, "DATA.csv"), csv), h("label", { className: "field" }, h("span", {}, "DATA.toml"), toml), h("button", { className: "btn" }, t("upload")));
  const own = h("div", { className: "stack" }, card(t("ownData"), send), fold(t("otherProgram"), "", mapped())), deleted = trail();
  root.append(head("", h("h1", { id: "title" }, t("view_of_data")), null), h("div", { className: "cols c7-5" }, h("div", { className: "stack" }, card(t("dataSets"), list), card(t("loops"), loops)), own), deleted);
  let known = [];
  const look = async () => {
    own.hidden = looksOn();
    const [{ datasets }, found] = await Promise.all([ask("GET", "/datasets"), ask("GET", "/loops")]);
    const shown = datasets.slice(0, MOST), stale = JSON.stringify(shown.map((each) => each.id)) !== JSON.stringify(known.map(([each]) => each.id));
    if (stale || known.some(([, jobs]) => jobs.some(inHand)) || !look.at || Date.now() - look.at > 10000) {
      look.at = Date.now();
      known = await Promise.all(shown.map(async (data) => [data, (await ask("GET", `/datasets/${data.id}/jobs`)).jobs]));
    }
    fill(list, [known.map(([data, jobs]) => [data.id, jobs.map((job) => [job.id, job.state])]), looksOn()], () => known.length ? known.flatMap(([data, jobs]) => [rowOfDataset(data), ...jobs.map(rowOfJob)]) : h("li", {}, t("noDataSets")));
    fill(loops, found.loops.map((each) => [each.id, each.state]), () => found.loops.length ? found.loops.map((each) => h("li", {},
      h("a", { href: `#/${each.state === "succeeded" && !each.dry_run ? "verify" : "diagnose"}/${each.id}`, className: "do" }, `${sign(each.state)} ${each.name} ${moment(new Date(each.created_utc))}`), h("span", { className: "sub" }, each.dry_run ? t("dryRunShort") : outcome(each)))) : h("li", {}, t("noLoops")));
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
      told.replaceChildren(h("p", {}, t("mappedTo", { name: made.name, n: made.readings }), fit ? ` ${t("mappedFit", { robot: fit.robot, mm: number(fit.miss_mm) })}` : ""), h("ul", { className: "plain" }, made.said.map((each) => h("li", {}, each))));
      send.reset();
    });
  } } }, h("label", { className: "field" }, h("span", {}, t("foreignFiles")), files), h("label", { className: "field" }, h("span", {}, "MAP.toml"), map), h("button", { className: "btn" }, t("upload")));
  return [h("p", { className: "sub" }, t("otherProgramHint")), send, told];
}

// What was deleted from this record, newest first; read when it is opened.
function trail() {
  const list = h("div", {}), whole = fold(t("deletedSoFar"), "", list);
  whole.id = "trail";
  whole.addEventListener("toggle", () => { if (whole.open) order(async () => {
    const { deletions } = await ask("GET", "/deletions");
    fill(list, deletions.length, () => (deletions.length ? table(t("deletedSoFar"), [t("when"), t("what"), t("by"), t("reason")],
      deletions.slice().reverse().map((each) => [moment(new Date(each.utc)), `${t(`kind_${each.kind}`)} ${each.name || each.id}`, each.by, each.reason])) : h("p", {}, t("nothingDeleted"))));
  }); });
  return whole;
}
