// Programs corrected with a model, and the model in other programs' formats: chosen here, saved as files.

import { keepFile, reckoned, save, upload } from "./connection.js";
import { order } from "./desk.js";
import { button, fill, h, numeric, table } from "./dom.js";
import { number } from "./units.js";
import { t } from "./words.js";

const KINDS = { urdf: "urdf", "ur-yaml": "yaml", "dh-csv": "csv", "dh-md": "md", mastering: "csv" }, MOST = 100;
const ENDINGS = ".mod,.modx,.sys,.prg,.ls,.script,.urscript,.src,.dat,.dtx,.csv";
const bytesOf = (base64) => Uint8Array.from(atob(base64), (each) => each.charCodeAt(0));
const field = (id, words, props = {}) => [h("input", { id, maxLength: 1000, autocomplete: "off", ...props }), words];

// A program or a table of targets, corrected with the model of this result.
export function programs(id) {
  const file = h("input", { type: "file", id: "program", accept: ENDINGS, required: true }), told = h("div", { role: "status", id: "corrected" });
  const [tool, frame, conditions] = ["tool", "frame", "conditions"].map((name) => h("input", { id: name, maxLength: 1000, size: 24, autocomplete: "off", placeholder: { tool: "0,0,100,0,0,0", frame: "0,0,0,0,0,0", conditions: "side=below" }[name] }));
  const inverse = h("input", { type: "checkbox", id: "inverse" }), keep = h("input", { type: "checkbox", id: "keep-refused" });
  const send = (event) => {
    event.preventDefault();
    told.replaceChildren();
    order(async () => {
      const program = file.files[0], given = { program, conditions: conditions.value.trim(), inverse: inverse.checked, keep_refused: keep.checked };
      for (const each of [tool, frame]) if (each.value.trim()) given[each.id] = each.value.trim();
      let done;
      try { done = await upload(`/models/${id}/programs`, given); }
      catch (error) { if (error.told && error.told.targets) told.replaceChildren(refusals(error.told.targets)); throw error; }
      keepFile(new Blob([bytesOf(done.program_base64)]), `corrected-${program.name}`);
      const left = done.targets.filter((each) => each.status === "refused").map((each) => ({ ...each, reason: each.reason || "" }));
      told.replaceChildren(h("p", {}, t("corrected", { n: done.corrected, refused: done.refused, mm: number(done.largest_move_mm) })), ...(left.length ? [refusals(left)] : []),
        ...(done.warnings.length ? [h("ul", {}, done.warnings.map((each) => h("li", {}, each)))] : []));
    });
  };
  return h("section", { className: "wide" }, h("h2", {}, t("programs")), h("p", { className: "dim" }, t("programsHint")),
    h("form", { className: "form", on: { submit: send } }, h("label", {}, t("programFile"), file), h("label", {}, t("programTool"), tool), h("label", {}, t("programFrame"), frame), h("label", {}, t("programConditions"), conditions),
      h("label", { className: "check" }, inverse, t("programInverse")), h("label", { className: "check" }, keep, t("keepRefused")), h("button", {}, t("correct"))), told);
}

function refusals(targets) {
  return table(t("refusedTargets"), [t("target"), t("line"), t("reason")], targets.slice(0, MOST).map((each) => [each.target, numeric(each.line === null ? "" : String(each.line)), each.reason]));
}

// The model for other programs; `certified`: whether there is a digital certificate of this kind of result.
export function exportsOf(id, certified) {
  const kind = h("select", { id: "export-as" }, Object.keys(KINDS).map((each) => h("option", { value: each }, t(`export_${each.replace("-", "_")}`)))), told = h("div", { role: "status" });
  const write = button(t("writeFile"), () => order(async () => {
    const done = await reckoned(`/models/${id}/exports/${kind.value}`);
    keepFile(new Blob([done.text], { type: "text/plain" }), `${id}.${KINDS[kind.value]}`);
    fill(told, done, () => h("ul", {}, [...done.about, ...done.warnings].map((each) => h("li", {}, each))));
  }), { id: "export-model" });
  const whole = h("section", { className: "wide" }, h("h2", {}, t("modelElsewhere")), h("p", { className: "dim" }, t("modelElsewhereHint")), h("div", { className: "row" }, h("label", { htmlFor: "export-as" }, t("format")), kind, write), told);
  return certified ? [whole, certificate(id)] : [whole];
}

function certificate(id) {
  const names = ["laboratory", "city", "country", "customer", "responsible"], fields = names.map((name) => field(`dcc-${name}`, t(`dcc_${name}`), name === "country" ? { maxLength: 2, size: 3, pattern: "[A-Za-z]{2}" } : { maxLength: 200 }));
  return h("section", { className: "wide" }, h("h2", {}, t("dcc")), h("p", { className: "dim" }, t("dccHint")), h("form", { className: "form", on: { submit: (event) => {
    event.preventDefault();
    const said = new URLSearchParams(fields.map(([input], i) => [names[i], input.value.trim()]).filter(([, value]) => value));
    order(() => save(`/results/${id}/certificate.xml?${said}`, `${id}-certificate.xml`));
  } } }, fields.map(([input, words]) => h("label", {}, words, input)), h("button", {}, t("writeFile"))));
}

