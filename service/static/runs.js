// Past runs, loops and verifications, newest first, each with its state and its last result.

import { ask } from "./connection.js";
import { card, fill, h } from "./dom.js";
import { outcome } from "./data.js";
import { deletion, menu } from "./menu.js";
import { active, loopOf } from "./road.js";
import { moment, sign, state } from "./units.js";
import { t } from "./words.js";

const MOST = 60, RESULTS = 20, AGAIN_MS = 5000;

// A card with `look()`.
export function runList() {
  const list = h("ul", { className: "list", id: "runs", ariaLabel: t("pastRuns") }), whole = card(t("pastRuns"), list);
  let asked = 0, found = {};
  whole.look = async () => {
    if (Date.now() - asked < AGAIN_MS) return;
    asked = Date.now();
    const [{ runs }, { loops }, { verifications }, { datasets }] = await Promise.all(["/runs", "/loops", "/verifications", "/datasets"].map((path) => ask("GET", path)));
    for (const data of datasets.filter((each) => each.run_id).slice(0, RESULTS)) {
      if (found[data.run_id] && found[data.run_id].result) continue;
      const [job] = (await ask("GET", `/datasets/${data.id}/jobs`)).jobs.filter((each) => ["diagnosis", "identification"].includes(each.kind)).sort((a, b) => (a.created_utc < b.created_utc ? 1 : -1));
      if (job) found[data.run_id] = job;
    }
    const rows = [...runs.filter((each) => !each.dry_run && !loopOf(each.id)).map((each) => ({ ...each, job: found[each.id] })), ...[...loops, ...verifications].filter((each) => !each.dry_run).map((each) => ({ ...each, loop: true, job: each.result || each.problem ? each : null }))].sort((a, b) => (a.id < b.id ? 1 : -1)).slice(0, MOST);
    whole.hidden = !rows.length;
    fill(list, rows.map((each) => [each.id, each.state, each.done, each.job && each.job.state]), () => rows.map((each) => h("li", {},
      h("a", { href: each.loop ? `#/${each.state === "succeeded" || each.model_id !== undefined ? "verify" : "diagnose"}/${each.id}` : `#/measure/${each.id}`, className: "do" }, `${sign(each.state)} ${each.name || each.id}`),
      h("span", { className: "sub" }, [moment(stamp(each.id)), state(each.state), each.loop ? (active(each) ? each.step : "") : t("doneOf", { done: each.done, total: each.total })].filter(Boolean).join(" · ")),
      h("span", {}, each.job ? (each.loop ? outcome(each.job) : h("a", { href: `#/diagnose/${each.job.id}`, className: "do" }, outcome(each.job))) : t("noResult")), menu(() => [!each.loop && deletion(`/runs/${each.id}`, each.name || each.id)]))));
  };
  return whole;
}

// An id begins with its moment, UTC.
function stamp(id) {
  const [, y, mo, d, ho, mi, s] = id.match(/^(\d{4})(\d\d)(\d\d)-(\d\d)(\d\d)(\d\d)/) || [];
  return new Date(Date.UTC(y, mo - 1, d, ho, mi, s));
}
