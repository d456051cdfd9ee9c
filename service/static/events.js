// The events of a run as they come: server-sent events by fetch, since an EventSource cannot send a token.

import { API, bearer, signals } from "./connection.js";
import { wait } from "./dom.js";

const TURN_MS = 400;
let kept = { id: "", events: [] };  // of the run that was followed last: a view that is opened anew has them at once

signals.addEventListener("left", () => { kept = { id: "", events: [] }; });

// Hands every batch of events to `hear` until `control` is aborted or `over()`; `lost()`: the service may be gone.
export async function follow(id, control, { hear, over, lost }) {
  if (kept.id !== id) kept = { id, events: [] };
  const mine = kept, last = mine.events.at(-1);
  let seen = last ? String(last.id) : "", text = "", fresh = [...mine.events];
  const turn = () => {
    if (!fresh.length || control.signal.aborted) return;
    const events = fresh;
    fresh = [];
    hear(events);
  };
  const ticking = setInterval(turn, TURN_MS);
  control.signal.addEventListener("abort", () => clearInterval(ticking));
  while (!control.signal.aborted) {
    try {
      const headers = { ...bearer(), ...(seen ? { "Last-Event-ID": seen } : {}) };
      const answer = await fetch(`${API}/runs/${id}/events`, { headers, signal: control.signal });
      if (answer.status >= 400 && answer.status < 500) break;
      const reader = answer.body.pipeThrough(new TextDecoderStream()).getReader();
      for (text = ""; ;) {
        const { value, done } = await reader.read();
        if (done) break;
        const blocks = (text + value.replaceAll("\r\n", "\n")).split("\n\n");
        text = blocks.pop();
        for (const block of blocks) {
          const data = block.split("\n").filter((line) => line.startsWith("data:")).map((line) => line.slice(5)).join("\n");
          if (!data) continue;
          const event = JSON.parse(data);
          fresh.push(event); mine.events.push(event); seen = String(event.id);
        }
      }
      if (over()) break;
    } catch { if (control.signal.aborted) return; }
    lost();
    await wait(1000);
  }
  turn(); clearInterval(ticking);
}
