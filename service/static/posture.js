// The robot of the cell in any posture: only the picture moves.

import { reckoned } from "./connection.js";
import { desk } from "./desk.js";
import { h } from "./dom.js";
import { scenePicture } from "./scene.js";
import { t } from "./words.js";

const signed = (x) => String(x).replace("-", "−");

// A section with `look()`; hidden in a service without a cell.
export function posture() {
  const picture = scenePicture(t("robotPicture")), sliders = h("div", { className: "sliders" }), head = h("h2", {}, t("robot"));
  const whole = h("section", { className: "card halves", hidden: true }, h("div", {}, head, picture), h("div", {}, h("h2", {}, t("posture")), h("p", { className: "sub" }, t("postureHint")), sliders));
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
  whole.look = async () => {
    if (desk.cell) head.textContent = `${desk.cell.robot} (${desk.cell.robot_driver})`;
    if (!scene && desk.cell) { scene = await reckoned("/cell/scene"); whole.hidden = false; draw(); }
  };
  return whole;
}
