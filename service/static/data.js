// Data and results: every data set with what was found in it, loops, files of one's own, and what was deleted.

import { API, ask, save } from "./connection.js";
import { looksOn, order } from "./desk.js";
import { button, card, fill, fold, h, head, table } from "./dom.js";
import { begin, ownReadings } from "./foreign.js";
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

function rowOfJob(job) {
  const words = `${sign(job.state)} ${t(`kind_${job.kind}`)} ${moment(new Date(job.created_utc))}`;
  return h("li", { className: "under" }, ["identification", "diagnosis"].includes(job.kind) ? h("a", { href: `#/diagnose/${job.id}`, className: "do" }, words) : words, h("span", { className: "sub" }, outcome(job)));
}

function rowOfDataset(data) {
  const file = (ending) => ({ text: t("saveFile", { name: `data.${ending}` }), act: () => order(() => save(`/datasets/${data.id}/data.${ending}`, `${data.id}.${ending}`)) });
  return h("li", { className: "head-row", "data-id": data.id }, h("span", {}, h("strong", {}, data.name), h("span", { className: "sub" }, ` ${t("readingsN", { n: data.readings })}, ${moment(new Date(data.created_utc))}`)),
    h("span", { className: "row" }, looksOn() ? null : button(t("diagnose"), () => order(() => begin("diagnoses", data.id))), menu(() => [file("csv"), file("toml"), !looksOn() && { text: t("identify"), act: () => order(() => begin("identifications", data.id)) }, data.run_id && { text: t("toRun"), act: () => { location.hash = `#/measure/${data.run_id}`; } }, deletion(`/datasets/${data.id}`, data.name)])));
}

export function open(root) {
  const list = h("ul", { className: "list", id: "datasets", ariaLabel: t("dataSets") }), loops = h("ul", { className: "list", ariaLabel: t("loops") });
  const title = h("h1", { id: "title" }, ""), lead = h("p", { className: "lead" }), lists = h("div", { className: "stack" }, card(t("dataSets"), list), card(t("loops"), loops)), deleted = trail(), both = h("div", { className: "cols c7-5" }, lists);
  const own = ownReadings((proposal) => {
    for (const [node, words] of [[title, t(proposal ? "foreignTitle" : "view_of_data")], [lead, proposal ? t("foreignLead") : ""]]) if (node.textContent !== words) node.textContent = words;
    both.hidden = deleted.hidden = proposal;
  });
  both.append(own.choose);
  root.append(head("", title, lead), own.busy, both, own.sheet, deleted, own.foot);
  let known = [];
  const look = async () => {
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
  const show = () => { own.show(); own.choose.hidden = own.choose.hidden || looksOn(); };
  show();
  return { look, show };
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
