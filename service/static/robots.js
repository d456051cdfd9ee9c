// The view Robots: the robot of the cell, posture by posture, and what was found on every robot so far.

import { ask, reckoned } from "./connection.js";
import { desk } from "./desk.js";
import { fill, h, numeric, table } from "./dom.js";
import { scenePicture } from "./scene.js";
import { moment, number } from "./units.js";
import { t } from "./words.js";
import { errorsOf } from "./ladder.js";

const signed = (x) => String(x).replace("-", "−");
const MOST = 40;  // data sets that are looked through

export function open(root) {
  const picture = scenePicture(t("robotPicture")), sliders = h("div", { className: "sliders" }), found = h("div", {}), head = h("h2", {}, t("robot"));
  root.append(h("section", { className: "wide halves" }, h("div", {}, head, picture), h("div", {}, h("h2", {}, t("posture")), h("p", { className: "dim" }, t("postureHint")), sliders)),
    h("section", { className: "wide" }, h("h2", {}, t("foundSoFar")), found));
  let scene = null, latest = 0;
  const pose = async (joints) => {
    const mine = (latest += 1), made = await reckoned(`/cell/scene?joints_deg=${joints.join(",")}`);
    if (mine === latest) picture.show({ ...made, described: t("robotDescribed", { joints: joints.join(", ") }) });
  };
  const draw = () => {
    const joints = scene.joints_deg.map((each) => Math.round(each));
    picture.show({ ...scene, described: t("robotDescribed", { joints: joints.join(", ") }) });
    sliders.replaceChildren(...scene.limits_deg.map(([low, high], i) => {
      const says = h("output", {}, `${signed(joints[i])}°`);
      const slider = h("input", { type: "range", min: Math.ceil(low), max: Math.floor(high), value: joints[i], on: { input: () => {
        joints[i] = Number(slider.value); says.textContent = `${signed(slider.value)}°`;
        pose(joints).catch(() => {});
      } } });
      return h("label", {}, h("span", {}, `${t("joint")} ${i + 1}, ${signed(low)}° … ${signed(high)}°`), slider, says);
    }));
  };
  const look = async () => {
    if (desk.cell) head.textContent = `${desk.cell.robot} (${desk.cell.robot_driver})`;
    if (!scene && desk.cell) { scene = await reckoned("/cell/scene"); draw(); }
    const { datasets } = await ask("GET", "/datasets");
    const jobs = (await Promise.all(datasets.slice(0, MOST).map(async (data) => (await ask("GET", `/datasets/${data.id}/jobs`)).jobs.map((job) => [data, job])))).flat()
      .filter(([, job]) => job.state === "succeeded" && ["identification", "diagnosis"].includes(job.kind));
    fill(found, jobs.map(([, job]) => job.id), () => jobs.length ? table(t("foundSoFar"), [t("when"), t("robot"), t("dataSet"), t("asFound"), t("after"), t("result")],
      jobs.sort(([, a], [, b]) => (a.id < b.id ? 1 : -1)).map(([data, job]) => {
        const { first, last } = errorsOf(job);
        return [moment(new Date(job.created_utc)), data.robot, data.name + (data.simulated ? ` (${t("simulatedShort")})` : ""), numeric(number(first)), numeric(number(last)),
          h("a", { href: `#/result/${job.id}`, className: "do" }, t(`kind_${job.kind}`))];
      })) : h("p", {}, t("nothingFoundYet")));
  };
  return { look, show: () => {} };
}
