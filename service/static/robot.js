// The view Robot: how one robot is and what to do, its trends, when it is to be checked, what is kept of it.

import { Refusal, ask, reckoned } from "./connection.js";
import { looksOn, order } from "./desk.js";
import { card, fill, fold, h, numeric, table } from "./dom.js";
import { link } from "./data.js";
import { causeOf, day, dueOf, lastSaid, stateOf, withU } from "./history.js";
import { judgeForm, planForm } from "./judging.js";
import { AGAIN_MS, doubt, errorOf, refusal } from "./robots.js";
import { trendCard } from "./trend.js";
import { number, sign, state } from "./units.js";
import { t } from "./words.js";

const ERROR = "error_rms", SHORT = 12;

export function open(root, id) {
  if (!id) { location.hash = "#/robots"; return { look: async () => {}, show: () => {} }; }
  const says = h("p", { role: "status", id: "store-says" }), top = h("section", { className: "card" }, h("h1", { id: "title" }, t("robot")), says), due = h("section", { className: "card" }), charts = card(t("trends"), h("p", { className: "sub" }, t("markSignal")));
  const pictures = h("div", {}), made = h("ul", { className: "list", ariaLabel: t("watchesHere") }), papers = h("div", {});
  let robot = null, asked = 0, reckoning = { method: "staircase", permitted_mm: "" };
  const model = h("select", { id: "baseline" }), baseline = () => ({ model_document: model.value }), judge = judgeForm(baseline), hint = h("p", { className: "sub" });
  const acting = h("section", { className: "card", hidden: true }, h("h2", {}, t("planWatch")), hint, h("p", {}, h("label", {}, t("judgedBy"), " ", model)), planForm(baseline), h("div", { className: "also" }, h("h3", {}, t("judgeReadings")), h("p", { className: "sub" }, t("judgeHint")), judge));
  charts.append(pictures);
  root.append(h("div", { className: "halves" }, top, due), charts, acting, card(t("watchesHere"), made), card(t("documents"), papers));
  const permitted = h("input", { type: "number", id: "permitted", min: 0.001, step: "any", max: 1000 }), head = h("div", {}), date = h("div", {});
  top.append(head); due.append(h("h2", {}, t("nextCheck")), date, reckon());

  function reckon() {
    const method = h("select", { id: "method" }, ["staircase", "drift"].map((each) => h("option", { value: each }, t(`method_${each}`))));
    return h("form", { className: "form", on: { submit: (event) => { event.preventDefault(); reckoning = { method: method.value, permitted_mm: permitted.value }; asked = 0; order(async () => {}); } } },
      h("label", { className: "field" }, h("span", {}, t("permittedError")), permitted), h("label", { className: "field" }, h("span", {}, t("byMethod")), method), h("button", { className: "btn" }, t("reckonAgain")));
  }

  function show() {
    const said = robot.watched;
    fill(head, [robot.state, said, robot.error_mm, robot.beyond_permitted, robot.last_measured, robot.left_out], () => [
      h("p", { className: "big" }, `${robot.serial} (${robot.model}) `, stateOf(robot.state)),
      h("p", { className: "big" }, `${t("whatToDo")} `, robot.state === "retired" ? t("doRetired") : robot.state === "not_watched" || robot.state === "recalibrated" ? t("doPlan") : said.advice),
      said ? h("p", {}, `${t("watchedOn", { date: day(said.measured) })} `, said.in_words) : null,
      robot.diagnosed && lastSaid(robot) === robot.diagnosed ? h("p", {}, `${t("diagnosedOn", { date: day(robot.diagnosed.measured) })} ${t(`said_${robot.diagnosed.verdict}`)}. `, robot.diagnosed.causes.length ? h("strong", {}, robot.diagnosed.causes.map(causeOf).join("; ")) : robot.diagnosed.in_words) : null,
      said && said.causes.length ? h("p", {}, `${t(said.causes.length > 1 ? "classOfCauses" : "lastCause")}: `, h("strong", {}, causeOf(said.causes[0]))) : null,
      said && said.causes.length > 1 ? h("ul", {}, said.causes.map((each) => h("li", {}, `${causeOf(each)}: `, each.in_words))) : null,
      h("dl", { className: "facts" }, fact("positionError", errorOf(robot)), fact("lastMeasured", day(robot.last_measured)), fact("cells", robot.cells.join(", ")), fact("baseline", robot.baseline ? day(robot.baseline.measured) : "–")), doubt(robot)]);
    fill(date, [robot.due, robot.permitted_mm], () => [h("p", { className: "big" }, dueOf(robot.due)), h("p", {}, robot.due.because),
      h("p", { className: "sub" }, `${t("byIlac", { method: t(`method_${reckoning.method}`) })} ${robot.permitted_mm ? t("permittedIs", { mm: number(robot.permitted_mm) }) : t("permittedUnknown")}`)]);
    fill(papers, [robot.history, robot.left_out], () => [documents(robot.history), robot.left_out ? h("p", { className: "sub" }, t("olderLeftOut", { n: robot.left_out })) : null]);
    permitted.placeholder = robot.permitted_mm || "";
    acting.hidden = looksOn() || !robot.baseline;
    hint.textContent = t("baselineHint");
    const models = robot.history.filter((each) => each.kind === "model");
    fill(model, models.map((each) => each.document), () => models.map((each) => h("option", { value: each.document, selected: each.document === robot.baseline.document },
      `${day(each.measured)}, ${each.error_mm ? `${t("errorOf")} ${withU(each.error_mm.rms, each.error_mm.u, "mm")}` : t("updatedByWatch")}`)));
  }

  const look = async () => {
    if (Date.now() - asked > AGAIN_MS) {
      asked = Date.now();
      const query = new URLSearchParams({ method: reckoning.method, ...(reckoning.permitted_mm ? { permitted_mm: reckoning.permitted_mm } : {}) });
      try {
        robot = await reckoned(`/robots/${id}?${query}`);
        drawTrends(pictures, (await reckoned(`/robots/${id}/trends`)).trends, robot.permitted_mm);
        says.replaceChildren();
        show();
      } catch (error) { if (!(error instanceof Refusal)) throw error; says.replaceChildren(...refusal(error)); }
      if (!robot) return;
      const lists = await Promise.all([["watch-plans", "watch_plans"], ["watches", "watches"], ["upkeeps", "upkeeps"]].map(async ([path, name]) => (await ask("GET", `/${path}`))[name]));
      const own = new Set(robot.history.map((each) => each.document)), jobs = lists.flat().filter((each) => own.has(each.baseline.sha256)).sort((a, b) => (a.id < b.id ? 1 : -1));
      fill(made, jobs.map((each) => [each.id, each.state]), () => (jobs.length ? jobs.map((each) => h("li", {}, h("a", { href: `#/watch/${each.id}`, className: "do" }, `${sign(each.state)} ${t(`kind_${each.kind}`)} ${day(each.created_utc)}: ${outcome(each)}`))) : h("li", {}, t("noneYet"))));
      if (!acting.hidden) await judge.look();
    }
  };
  return { look, show: () => {} };
}

const outcome = (job) => (job.result && job.result.verdict ? t(`robot_${job.result.verdict}`) : state(job.state));
const fact = (name, what) => h("div", {}, h("dt", {}, t(name)), h("dd", {}, what));

// What lies outside its limits first, and the error before all; the steady ones are there to be opened.
function drawTrends(place, trends, permitted) {
  fill(place, [trends, permitted, innerWidth < 700], () => {
    const error = trends.filter((each) => each.parameter === ERROR), rest = trends.filter((each) => each.parameter !== ERROR);
    const loud = rest.filter((each) => each.signals.length), charted = rest.filter((each) => !each.signals.length && each.values.length > 1), single = rest.filter((each) => each.values.length === 1);
    const several = h("div", { className: "trends" }), steady = fold(t("steadyOnes", { n: charted.length }), "", several);
    steady.id = "steady";
    steady.addEventListener("toggle", () => { if (steady.open && !several.hasChildNodes()) several.append(...charted.map((each) => trendCard(each))); });
    return [h("div", { className: "trends" }, error.map((each) => trendCard(each, { wide: true, permitted })), loud.map((each) => trendCard(each))), !trends.length ? h("p", {}, t("noTrends")) : null, charted.length ? steady : null,
      single.length ? fold(t("singleOnes", { n: single.length }), "", table(t("trends"), [t("parameter"), t("value"), t("unit"), t("when")], single.map((each) => [each.parameter, numeric(withU(each.values[0].value, each.values[0].u)), each.unit, day(each.values[0].measured)]))) : null];
  });
}

function documents(lines) {
  const says = (each) => [each.verdict ? t(`said_${each.verdict}`) : "", each.causes.length ? causeOf(each.causes[0]) : "", each.error_mm ? `${t("errorOf")} ${withU(each.error_mm.rms, each.error_mm.u, "mm")}` : ""].filter(Boolean).join("; ");
  return lines.length ? h("ul", { className: "list papers", ariaLabel: t("documents") }, lines.map((each) => h("li", {}, h("span", { className: "sub" }, day(each.measured)), h("strong", {}, t(`document_${each.kind}`)), h("span", { className: "says" }, says(each)),
    each.contradicts_another ? h("span", { className: "overdue" }, `⚠ ${t("contradicts")}`) : null, links(each)))) : h("p", {}, t("noneYet"));
}

function links(line) {
  const file = link("JSON", `/documents/${line.document}`, `${line.kind}-${line.document.slice(0, SHORT)}.json`);
  if (!line.here) return [file];
  const { kind, id } = line.here, view = { run: "measure", diagnosis: "diagnose", loop: "diagnose", watch: "watch", upkeep: "watch" }[kind];
  return [h("a", { href: `#/${view}/${id}`, className: "do" }, t("toResult")), ["diagnosis", "loop"].includes(kind) ? h("a", { href: `#/report/${id}`, className: "do" }, t("openReport")) : null, file].filter(Boolean);
}
