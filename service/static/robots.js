// Robots and past runs: every robot of the history in a line, what needs care first; then what was measured here.

import { Refusal, reckoned, upload } from "./connection.js";
import { desk, looksOn, order } from "./desk.js";
import { card, fill, fold, h, head } from "./dom.js";
import { causeOf, day, dueOf, lastSaid, stateOf, withU } from "./history.js";
import { posture } from "./posture.js";
import { runList } from "./runs.js";
import { sparkline } from "./trend.js";
import { number } from "./units.js";
import { t } from "./words.js";

export const AGAIN_MS = 15000;
const FEW = 12;  // robots that a person takes in at a glance

// What a store that cannot be asked says, with what to do; what was shown stays.
export const refusal = (error) => [h("strong", {}, "✖ ", error.message), " ", h("span", {}, `${t("whatToDo")} `, error.whatToDo)];

export function open(root) {
  const list = h("ul", { className: "robots", ariaLabel: t("view_of_robots") }), says = h("p", { role: "status", id: "store-says" }), about = h("p", { className: "sub" });
  const refused = h("div", {}), arm = posture(), file = h("input", { type: "file", id: "document", accept: ".json", multiple: true, required: true });
  const serial = h("input", { id: "serial", maxLength: 200, size: 16 });
  const send = h("form", { className: "form", on: { submit: (event) => {
    event.preventDefault();
    order(async () => {
      const told = [];
      for (const each of file.files) told.push([each.name, (await upload("/documents", { file: each, serial: serial.value.trim() })).added[0]]);
      kept.replaceChildren(...told.map(([name, added]) => h("li", {}, `${name}: ${t(`added_${added.state}`)}`,
        added.contradicts.length ? h("span", {}, ` (${added.contradicts.map((hash) => hash.slice(0, 12)).join(", ")})`) : null)));
      send.reset(); asked = 0;
    });
  } } }, h("label", { className: "field" }, h("span", {}, t("documentFiles")), file), h("label", { className: "field" }, h("span", {}, t("serialWhereNone")), serial), h("button", { className: "btn" }, t("keepThem"))), kept = h("ul", { role: "status" });
  const adding = fold(t("addDocuments"), "", h("p", { className: "sub" }, t("addDocumentsHint")), send, kept);
  const search = h("input", { type: "search", id: "search", size: 28, on: { input: () => { if (known) show(known); } } }), care = h("h1", { ariaLive: "polite", id: "title" }, t("view_of_robots"));
  const rest = h("ul", { className: "robots", ariaLabel: t("robotsAtRest") }), others = fold("", "", rest), count = others.querySelector(".what"), past = runList();
  others.id = "others"; others.hidden = true;
  let known = null;
  root.append(head("", care, h("p", { className: "lead" }, t("robotsLead"))), card(t("robotsKept"), says, h("label", { className: "field" }, h("span", {}, t("searchRobots")), search), list, others, about, refused), past, adding, arm);
  let asked = 0;

  const show = (found) => {
    fill(about, [found.store, found.permitted_mm, found.left_out], () => [t("storeIs", { store: found.store }), " ", found.permitted_mm ? t("permittedIs", { mm: number(found.permitted_mm) }) : t("permittedUnknown"),
      found.left_out ? ` ${t("robotsLeftOut", { n: found.left_out })}` : ""]);
    const { need_care: n, permitted_mm: permitted } = found, all = found.robots.length + found.left_out, sought = search.value.trim().toLowerCase();
    const shown = found.robots.filter((each) => [each.serial, each.model, ...each.cells].some((name) => name.toLowerCase().includes(sought))), [ill, well] = [true, false].map((cares) => shown.filter((each) => each.needs_care === cares));
    const lines = (robots) => robots.map((each) => h("li", { className: each.needs_care ? "cares" : "" }, line(each, permitted)));
    fill(care, [n, all], () => [!all ? t("view_of_robots") : n ? t("careFor", { n, all }) : t("careForNone", { all })]);
    fill(list, [ill, permitted, all, shown.length], () => (!all ? h("li", { className: "none" }, t("noRobots")) : shown.length ? lines(ill) : h("li", { className: "none" }, t("nothingFound"))));
    fill(count, well.length, () => [t("othersAtRest", { n: well.length })]);
    fill(rest, [well, permitted], () => lines(well));
    others.hidden = !well.length;
    if (!known || sought) others.open = Boolean(sought) || !ill.length || all <= FEW;
    known = found;
    fill(refused, found.not_kept, () => found.not_kept.length ? h("details", {}, h("summary", {}, `⚠ ${t("notKept", { n: found.not_kept.length })}`),
      h("ul", {}, found.not_kept.map((each) => h("li", {}, each.path ? `${each.path}: ${each.because}` : each.because)))) : null);
  };
  const look = async () => {
    adding.hidden = looksOn();
    if (Date.now() - asked > AGAIN_MS) {
      asked = Date.now();
      try { show(await reckoned("/robots")); says.replaceChildren(); }
      catch (error) { if (!(error instanceof Refusal)) throw error; says.replaceChildren(...refusal(error)); }
    }
    if (desk.cell || !past.hidden) await past.look();
    await arm.look();
  };
  return { look, show: () => {} };
}

// The last position error, with a sign where it is more than permitted; and a date that only a wrong clock can have written.
export const errorOf = (robot) => h("span", { className: robot.beyond_permitted ? "overdue" : "" }, robot.error_mm ? `${robot.beyond_permitted ? "⚠ " : ""}${withU(robot.error_mm.rms, robot.error_mm.u, "mm")}` : "–");
export const doubt = (robot) => (robot.doubtful_date ? h("p", { className: "advice overdue" }, `⚠ ${t("doubtfulDate", { date: day(robot.doubtful_date) })}`) : null);

function line(robot, permitted) {
  const said = lastSaid(robot), cause = said && said.causes[0];
  const fact = (name, ...what) => h("div", {}, h("dt", {}, t(name)), h("dd", {}, what));
  return [h("div", { className: "whose" }, h("a", { href: `#/robot/${robot.id}`, className: "do", "data-name": robot.id }, robot.serial), h("span", { className: "sub" }, `${robot.model} · ${robot.cells.join(", ")}`), stateOf(robot.state)),
    h("dl", {}, fact("lastCause", cause ? causeOf(cause) + (said.causes.length > 1 ? ` ${t("orOthers", { n: said.causes.length - 1 })}` : "") : t("noCause")),
      fact("saidLast", said ? `${day(said.measured)}: ${t(`said_${said.verdict}`)}` : "–"), fact("positionError", errorOf(robot)), fact("nextCheck", dueOf(robot.due)), fact("lastMeasured", day(robot.last_measured))),
    h("div", { className: "spark-of" }, robot.errors.length ? sparkline(robot.errors, permitted) : h("span", { className: "sub" }, t("noErrors"))),
    ["changed", "ambiguous", "unexplained"].includes(robot.state) ? h("p", { className: "advice" }, `${t("whatToDo")} `, robot.watched.advice) : null, doubt(robot)].filter(Boolean);
}
