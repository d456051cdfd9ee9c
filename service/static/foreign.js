// Readings from files: a data set goes straight in; a file of another program is shown with what its columns seem to be, and
// what it does not show is asked. The service keeps nothing of it: the files go again with every answer.

import { asked } from "./acceptance.js";
import { ask, key, signals, upload } from "./connection.js";
import { desk, order } from "./desk.js";
import { $, button, card, fill, fold, footBar, h, icon, noteBox, numeric, table } from "./dom.js";
import { KEYS, t } from "./words.js";

const LARGEST_MB = 32;  // which the service takes at once; it cuts the connection of whoever sends more
const SHOWN = 3, RADIOS = 6, HINTS = ["robot", "instrument", "sigma_mm"];
// `files`; `answers` by key, and `good` those of the last proposal, `told`; `questions` that were asked, also when they are
// answered; `turn`: the number of the last request, whose answer alone counts, and `done` that of the last answer.
let given = null, turns = 0;
signals.addEventListener("left", () => { given = null; });

const plain = (file) => file.name.replace(/\.\w+$/, "");
const ofColumn = (each) => /^(\d\.)?column\./.test(each);
const choiceWords = (choice) => (KEYS.includes(`choice_${choice}`) ? t(`choice_${choice}`) : choice);
const readingWords = (choice) => (/^j\d+$/.test(choice) ? t("jointN", { n: choice.slice(1) }) : t(`as_${choice}`));

// What is diagnosed needs no further click.
export const begin = async (kind, dataset) => { location.hash = `#/diagnose/${(await ask("POST", `/${kind}`, { dataset_id: dataset, ...asked() }, key())).id}`; };
const goesIn = async (path, files) => { const made = await upload(path, files); given = null; await begin("diagnoses", made.id); };

async function propose() {
  const mine = given, turn = (given.turn = turns += 1), answer = [...given.answers].map(([each, value]) => `${each}=${value}`);
  try {
    const told = await upload("/proposals", { files: given.files, answer });
    if (given !== mine || mine.turn !== turn) return;
    for (const each of told.questions) given.questions.set(each.key, each);
    Object.assign(given, { told, good: new Map(given.answers), done: turn });
  } catch (error) {
    if (given !== mine || mine.turn !== turn) return;
    Object.assign(given, { answers: new Map(given.good), done: turn });
    throw error;
  }
}

// The chooser of files, and the sheet of a proposal with its foot. `shown()`: whether it is a proposal that is to be seen.
export function ownReadings(shown) {
  const sheet = h("div", { className: "cols c5-7", hidden: true }), foot = footBar(t("next")), busy = h("p", { className: "sub", role: "status", id: "reading-file" });
  foot.firstChild.setAttribute("role", "status");
  const chooser = h("input", { type: "file", multiple: true, id: "readings", "aria-describedby": "readings-hint", on: { change: () => { take([...chooser.files]); chooser.value = ""; } } });
  const drop = h("label", { className: "drop", on: {
    dragover: (event) => { event.preventDefault(); drop.classList.add("over"); },
    dragleave: () => drop.classList.remove("over"),
    drop: (event) => { event.preventDefault(); drop.classList.remove("over"); take([...event.dataTransfer.files]); },
  } }, icon("file"), h("strong", {}, t("chooseReadings")), h("span", { className: "sub" }, t("orDrop")), chooser);
  const choose = card(t("ownData"), drop, h("p", { className: "sub", id: "readings-hint" }, t("readingsHint")));

  const work = (what) => order(async () => {
    busy.textContent = t("readingFile"); show();
    try { await what(); }
    catch (error) { scrollTo(0, 0); throw error; }
    finally { busy.textContent = ""; show(); }
  });

  const take = (files) => work(async () => {
    const tables = files.filter((each) => !/\.toml$/i.test(each.name)), [toml, ...more] = files.filter((each) => !tables.includes(each));
    const large = files.find((each) => each.size > LARGEST_MB * 2 ** 20);
    if (large) throw new Error(t("tooLarge", { name: large.name, mb: LARGEST_MB }));
    if (!tables.length || more.length || tables.length > 2) throw new Error(t("whichFiles"));
    const map = toml && /^\s*format\s*=\s*["']truepose-map\//m.test(await toml.text());
    if (toml && !map && tables.length > 1) throw new Error(t("whichFiles"));
    if (map) { await goesIn("/datasets/mapped", { files: tables, map: toml, name: plain(tables[0]) }); return; }
    if (toml) { await goesIn("/datasets", { csv: tables[0], toml, name: plain(tables[0]) }); return; }
    given = { files: tables, answers: new Map(), good: new Map(), questions: new Map(), told: null, turn: 0, done: 0, used: false };
    try { await propose(); }
    catch (error) { given = null; throw error; }
    show();
    if (!sheet.isConnected) return;
    $("title").tabIndex = -1; $("title").focus({ preventScroll: true }); scrollTo(0, 0);
  });

  // An answer; where it is refused, those before it count. Questions follow from the columns, and are asked anew with them.
  const answer = (each, value) => work(async () => {
    if (value) given.answers.set(each, value); else given.answers.delete(each);
    if (ofColumn(each)) for (const other of [...given.answers.keys()]) if (!ofColumn(other) && !HINTS.includes(other)) { given.answers.delete(other); given.questions.delete(other); }
    await propose();
  });
  const use = async () => {
    const mine = given;
    mine.used = true;  // pressed twice it is done once
    await work(() => goesIn("/datasets/mapped", { files: mine.files, map: new Blob([mine.told.map_text]), name: plain(mine.files[0]) }));
    mine.used = false; show();
  };
  const cancel = () => { given = null; show(); chooser.focus(); };

  const options = (value, choices, props) => h("select", { ...props, on: { change: (event) => answer(props["data-name"], event.target.value) } },
    choices.map(([choice, words]) => h("option", { value: choice, selected: choice === value }, words)));
  const field = (words, input, sub) => h("label", { className: "field" }, h("span", {}, words), input, sub && h("span", { className: "sub" }, sub));
  const typed = (name, words, sub, props = {}) => field(words, h("input", { "data-name": name, autocomplete: "off", maxLength: 500, value: given.answers.get(name) || "", ...props, on: { change: (event) => answer(name, event.target.value.trim()) } }), sub);

  function tables() {
    let from = 0;
    return given.told.tables.map((of) => {
      const columns = given.told.columns.slice(from, from += of.names.length), lines = of.lines.slice(0, SHOWN);
      const rows = columns.map((column, i) => {
        const name = `${of.prefix}column.${column.column}`, stated = given.answers.get(name) || "";
        const reading = options(stated, [["", stated ? t("asProposed") : column.read_as || t("as_leave")], ...given.told.choices.map((each) => [each, readingWords(each)])], { "data-name": name, ariaLabel: t("readAsOf", { column: column.column }) });
        return [column.column, [reading, h("span", { className: "sub" }, [column.unit, column.why].filter(Boolean).join(" · "))], ...lines.map((_, row) => numeric(of.rows[row][i] ?? ""))];
      });
      const title = [of.file, of.sheet].filter(Boolean).join(", ");
      return card(title, h("p", { className: "sub" }, t("readingsN", { n: of.readings })), table(t("columnsOf", { file: title }), [t("column"), t("readAs"), ...lines.map((line) => t("lineN", { n: line }))], rows));
    });
  }

  function question(of) {
    const value = given.answers.get(of.key) || "", words = (choice) => `${choiceWords(choice)}${choice === of.proposed ? ` (${t("likelyOne")})` : ""}`;
    const text = of.text.replace(/ \([^()]*within_s[^()]*\)/, "");  // which has a field of its own here
    if (!of.choices.length) return typed(of.key, text);
    if (of.choices.length > RADIOS) return field(text, options(value, [["", t("chooseOne")], ...of.choices.map((each) => [each, words(each)])], { "data-name": of.key }));
    return h("fieldset", { className: "stack asked" }, h("legend", {}, text), h("div", {}, of.choices.map((each) =>
      h("label", { className: "check" }, h("input", { type: "radio", name: of.key, "data-name": `${of.key}=${each}`, value: each, checked: each === value, on: { change: () => answer(of.key, each) } }), words(each)))));
  }

  function questions() {
    const { told, answers } = given, here = desk.cell && told.robots.includes(desk.cell.robot) ? desk.cell.robot : "", robot = answers.get("robot") || "";
    const robots = [["", t("chooseOne")], ...(here ? [[here, t("ofThisCell", { robot: here })]] : []), ...told.robots.filter((each) => each !== here).map((each) => [each, each])];
    const others = [...given.questions.values()].filter((each) => each.key !== "robot" && (answers.has(each.key) || told.questions.some((open) => open.key === each.key)));
    const measured = fold(t("instrument"), "", typed("instrument", t("instrumentName")), typed("sigma_mm", t("sigmaMm"), "", { inputMode: "decimal" }));
    measured.open = ["instrument", "sigma_mm"].some((each) => answers.has(each));
    return [card(t("questions"), field(t("whichRobot"), options(robot, robots, { "data-name": "robot", id: "which-robot" }), t(robot ? "otherRobots" : "robotFirst")), others.map(question),
      answers.get("match") === "time" ? typed("within_s", t("withinS"), "", { inputMode: "decimal" }) : null,
      measured),
    told.missing.length ? noteBox("ask", "alert", t("notInFile", { what: told.missing.join("; ") }), h("p", {}, t("notInFileHint"))) : null,
    card(t("howRead"), h("ul", { className: "plain" }, told.said.map((each) => h("li", {}, each))))];
  }

  function show() {
    const open = Boolean(given && given.told), waits = open && (given.used || given.done !== given.turn);
    sheet.hidden = !open;
    choose.hidden = open;
    shown(open);
    if (open) fill(sheet, given.done, () => [h("div", { className: "stack" }, questions()), h("div", { className: "stack columns" }, tables())]);
    const state = !open ? "" : waits ? "waits" : given.told.missing.length ? "missing" : given.told.complete ? "ready" : "open";
    foot.set([state, open && given.told.questions.length], { "": "", waits: t("readingFile"), missing: t("missingFoot"), open: open ? t("openFoot", { n: given.told.questions.length }) : "", ready: t("useFoot") }[state], () => (!open ? [] :
      [button(t("cancel"), cancel, { id: "cancel-readings", kind: "quiet" }), button(t("useReadings"), use, { id: "use-readings", kind: "primary", ic: "arrow", disabled: state !== "ready" })]));
  }
  return { choose, sheet, busy, foot, show };
}
