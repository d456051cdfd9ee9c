// The events of a run as lines, newest first.

import { h } from "./dom.js";
import { clock } from "./connection.js";
import { promptWords } from "./pictures.js";
import { number, state } from "./units.js";
import { t } from "./words.js";

const MOST = 300;

function summary({ kind, data }) {
  switch (kind) {
    case "state": return [state(data.state), data.reason ? [": ", data.reason] : ""];
    case "reading": return `${data.name}, ${data.target}` + (data.world_mm ? `: ${data.world_mm.map((x) => number(x)).join(", ")} mm` : "")
      + (typeof data.length_mm === "number" ? ` – ${data.base_target}: ${number(data.length_mm, 4)} mm` : "");
    case "command": return `${data.verb}: ${data.by || "?"}`;
    case "prompt": return promptWords(data) || data.text || "";
    case "answer": return `${t(`answer_${data.answer}`)}: ${data.by}${data.reason ? `: ${data.reason}` : ""}`;
    case "attempt_failed": case "reconnect": return data.error ? `${data.error.message}.` : "";
    default: return data.reason || data.message || data.text || (data.off_mm !== undefined ? `${number(data.off_mm)} mm` : "");
  }
}

// A list with `add(events)` and `warmingUntil()`.
export function eventList() {
  const list = h("ol", { id: "events", className: "log", tabIndex: 0, ariaLabel: t("events") });
  let until = null;
  list.add = (events) => {
    for (const { kind, data, utc, t_s: at } of events) {
      if (kind === "warm_up") until = { utc: new Date(utc), seconds: data.until_t_s - at };
      else if (["reading", "arrived", "prompt"].includes(kind)) until = null;
    }
    list.prepend(...events.slice(-MOST).reverse().map((event) => h("li", {}, h("span", {}, clock(new Date(event.utc))), h("span", {}, t(`event_${event.kind}`)), h("span", {}, summary(event)))));
    while (list.childElementCount > MOST) list.lastElementChild.remove();
  };
  list.warmingUntil = () => (until ? new Date(until.utc.getTime() + 1000 * until.seconds) : null);
  return list;
}
