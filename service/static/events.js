// The events of a run as they come: server-sent events by fetch, since an EventSource cannot send a token.

import { API, bearer } from "./connection.js";
import { wait } from "./dom.js";

const TURN_MS = 400;

// Hands every batch of events to `hear` until `control` is aborted or `over()`; `lost()`: the service may be gone.
export async function follow(id, control, { hear, over, lost }) {
  let seen = "", text = "", fresh = [];
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
          fresh.push(JSON.parse(data)); seen = String(fresh.at(-1).id);
        }
      }
      if (over()) break;
    } catch { if (control.signal.aborted) return; }
    lost();
    await wait(1000);
  }
  turn(); clearInterval(ticking);
}
