// The view Report: the report within the page, under the page's own policy: nothing in it runs, and nothing is loaded.

import { Silence, ask, save, text } from "./connection.js";
import { order } from "./desk.js";
import { button, card, fill, footBar, h, head } from "./dom.js";
import { moment, state } from "./units.js";
import { t } from "./words.js";

const MOST = 40;

export const open = (root, id) => (id ? one(root, id) : all(root));

function all(root) {
  const list = h("ul", { className: "list", ariaLabel: t("reports") });
  root.append(head("", h("h1", { id: "title" }, t("reports"))), card("", list));
  const look = async () => {
    const [{ datasets }, { loops }] = await Promise.all([ask("GET", "/datasets"), ask("GET", "/loops")]);
    const jobs = (await Promise.all(datasets.slice(0, MOST).map(async (data) => (await ask("GET", `/datasets/${data.id}/jobs`)).jobs.map((job) => ({ name: data.name, ...job }))))).flat();
    const done = [...jobs, ...loops.map((each) => ({ kind: "loop", ...each }))].filter((each) => each.report).sort((a, b) => (a.created_utc < b.created_utc ? 1 : -1));
    fill(list, done.map((each) => each.id), () => done.length ? done.map((each) => h("li", {}, h("a", { href: `#/report/${each.id}`, className: "do" }, `${t(`kind_${each.kind}`)} ${each.name} ${moment(new Date(each.created_utc))}`), state(each.state))) : h("li", {}, t("noReports")));
  };
  return { look, show: () => {} };
}

function one(root, id) {
  const place = h("div", { id: "report", role: "document", ariaLabel: t("report") }), says = h("p", { role: "status" }, t("loading"));
  const foot = footBar(t("next"));
  foot.set([], t("printHint"), () => [h("a", { href: `#/diagnose/${id}`, className: "btn", id: "to-result" }, t("toResult")), button(t("download"), () => order(() => save(`/reports/${id}`, `${id}-report.html`)), { id: "download", kind: "primary", ic: "down" })]);
  root.append(head("", h("h1", { id: "title" }, t("report")), says), h("section", { className: "card paper" }, place), foot);
  let shown = false;
  const look = async () => {
    if (shown) return;
    shown = true;
    try { adopt(place, await text(`/reports/${id}`)); says.textContent = ""; } catch (error) { says.textContent = ""; shown = !(error instanceof Silence); throw error; }
  };
  return { look, show: () => {} };
}

// The nodes of a report in a shadow tree of its own, so that neither its style nor its names meet the page's. Its style
// comes as a style sheet made here, since the policy of the page takes none from markup, not even from markup that is only
// read; scripts were never run.
export function adopt(place, html) {
  const css = [], plain = html.replace(/<style[^>]*>([\s\S]*?)<\/style>/gi, (_, rules) => { css.push(rules); return ""; }).replace(/\sstyle="/gi, ' data-style="')
    .replace(/<(\/?)main\b/gi, "<$1div");  // the page has its own main part
  const report = new DOMParser().parseFromString(plain, "text/html"), shadow = place.attachShadow({ mode: "open" });
  for (const each of report.querySelectorAll("script, iframe, object, embed, link, meta, base, form")) each.remove();
  const sheets = css.map((rules) => { const sheet = new CSSStyleSheet(); sheet.replaceSync(rules.replace(/(^|[\s,}])body\b/g, "$1.report-body").replace(/(^|[\s,}]):root\b/g, "$1:host")); return sheet; });
  shadow.adoptedStyleSheets = sheets;
  const body = h("div", { className: "report-body", lang: report.documentElement.lang || "en" });
  body.append(...[...report.body.childNodes].map((node) => document.importNode(node, true)));
  for (const each of body.querySelectorAll("*")) {
    if (each.dataset && each.dataset.style !== undefined) { each.style.cssText = each.dataset.style; delete each.dataset.style; }
    for (const { name, value } of [...each.attributes]) if (/^on/i.test(name) || (/^(xlink:)?(href|src)$/i.test(name) && !/^(#|data:image\/)/i.test(value))) each.removeAttribute(name);
  }
  shadow.append(body);
}
