// Planning a watch and judging readings, by a baseline: {model_id} of this service, or {model_document} of the history.

import { ask, key } from "./connection.js";
import { order } from "./desk.js";
import { fill, h } from "./dom.js";
import { moment } from "./units.js";
import { t } from "./words.js";

export const baselineOf = (id) => (id.length === 64 ? { model_document: id } : { model_id: id });

const field = (props) => h("input", { type: "number", required: true, inputMode: "numeric", ...props });

export function planForm(baseline) {
  const poses = field({ id: "plan-poses", value: 10, min: 1, max: 200 }), visits = field({ id: "plan-visits", required: false, min: 1, max: 20 }), readings = field({ id: "plan-readings", required: false, min: 1, max: 100 });
  const targets = h("input", { id: "plan-targets", maxLength: 500, size: 12 }), frame = h("input", { type: "checkbox" });
  return h("form", { className: "form", id: "plan-watch", on: { submit: (event) => {
    event.preventDefault();
    order(async () => {
      const names = targets.value.split(",").map((each) => each.trim()).filter(Boolean);
      const job = await ask("POST", "/watch-plans", { ...baseline(), poses: Number(poses.value), visits: Number(visits.value) || null, readings: Number(readings.value) || null, targets: names, new_frame: frame.checked }, key());
      location.hash = `#/watch/${job.id}`;
    });
  } } }, h("label", { className: "field" }, h("span", {}, t("checkPoses")), poses), h("label", { className: "field" }, h("span", {}, t("visitsOrEnough")), visits), h("label", { className: "field" }, h("span", {}, t("readingsOrEnough")), readings), h("label", { className: "field" }, h("span", {}, t("targetsOrAll")), targets), h("label", { className: "check" }, frame, t("newFrame")), h("button", { className: "btn" }, t("planWatch")));
}

// A form with `look()`, which offers the newest data sets and runs.
export function judgeForm(baseline) {
  const which = h("select", { id: "readings", required: true }), running = h("input", { type: "number", min: 0, step: "any", id: "running-s" }), frame = h("input", { type: "checkbox" }), missing = h("input", { type: "checkbox" });
  const send = (collection) => order(async () => {
    if (!form.reportValidity()) return;
    const [kind, id] = which.value.split(" "), more = collection === "watches" ? { new_frame: frame.checked } : {};
    if (running.value !== "") more.running_s = Number(running.value);
    const job = await ask("POST", `/${collection}`, { ...baseline(), [kind]: id, allow_missing: missing.checked, ...more }, key());
    location.hash = `#/watch/${job.id}`;
  });
  const form = h("form", { className: "form", id: "judge", on: { submit: (event) => { event.preventDefault(); send("watches"); } } }, h("label", { className: "field" }, h("span", {}, t("readingsOf")), which), h("label", { className: "field" }, h("span", {}, t("runningSince")), running),
    h("label", { className: "check" }, frame, t("newFrame")), h("label", { className: "check" }, missing, t("allowMissing")), h("button", { className: "btn" }, t("judge")), h("button", { type: "button", className: "btn", on: { click: () => send("upkeeps") } }, t("upkeep")));
  form.look = async () => {
    const [{ datasets }, { runs }] = await Promise.all([ask("GET", "/datasets"), ask("GET", "/runs")]);
    const done = runs.filter((each) => each.state === "succeeded" && !each.dry_run && !datasets.some((data) => data.run_id === each.id));
    fill(which, [datasets.map((each) => each.id), done.map((each) => each.id)], () => [
      ...done.slice(0, 50).map((each) => h("option", { value: `run_id ${each.id}` }, `${t("kind_run")} ${each.name} ${moment(new Date(each.created_utc))}`)),
      ...datasets.slice(0, 50).map((each) => h("option", { value: `dataset_id ${each.id}` }, `${t("kind_dataset")} ${each.name} ${moment(new Date(each.created_utc))}`)),
      ...(done.length + datasets.length ? [] : [h("option", { value: "", disabled: true, selected: true }, t("noReadings"))])]);
  };
  return form;
}
