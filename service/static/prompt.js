// The prompt of a run: one huge question with its picture, whose buttons are armed after it can have been read.

import { ask, connection } from "./connection.js";
import { desk, looksOn, moving, order } from "./desk.js";
import { fold, h, icon } from "./dom.js";
import { promptPicture, promptWords } from "./pictures.js";
import { KEYS, t } from "./words.js";

const ARMED_MS = 1500, NOT_ASKED = 3020, SAME = /^Seat the SMR in \S+ and press confirm\.$/, VERBS = ["confirm", "redo", "skip", "pause", "abort"];

// A card with `show(run, scene)` and `answer(verb, reason)`; `end()` asks once more before the campaign is ended. The buttons
// take no answer before the question can have been read: a click may have been meant for the one before.
export function promptCard(end) {
  let asked = "", armed = "", run = null, drawn = null;
  const question = h("p", { id: "question", className: "question" }), original = h("p", { id: "original", className: "sub" }), arming = h("p", { id: "arming", className: "sub", role: "status" });
  const picture = h("div", { className: "prompt-side" }), reason = h("input", { id: "reason", maxLength: 500, size: 30 });
  const shown = h("p", { id: "shown" }), typed = h("textarea", { id: "typed", rows: 2, maxLength: 2000, spellcheck: false, autocomplete: "off" });
  const entryName = h("span", {}), stopless = h("p", { id: "stopless", className: "warn" });
  const entry = h("div", { id: "entry", hidden: true }, shown, stopless, h("label", {}, entryName, typed));
  const looksOf = { confirm: "primary huge", skip: "huge", pause: "huge", abort: "danger-quiet" };
  const buttons = VERBS.map((verb) => h("button", { type: "button", className: `btn ${looksOf[verb] || ""}`, id: verb === "pause" ? "answer_pause" : verb, "data-answer": verb, on: { click: () => (verb === "abort" ? armed && end() : order(() => answer(verb))) } }, t(`answer_${verb}`)));
  const rare = ["redo", "abort"], often = buttons.filter((each) => !rare.includes(each.dataset.answer));
  const wrong = fold(t("somethingWrong"), "", h("label", { className: "field" }, h("span", {}, t("reasonKept")), reason), h("div", { className: "row" }, buttons.filter((each) => rare.includes(each.dataset.answer))));
  const card = h("section", { id: "asking", className: "prompt", tabIndex: -1, ariaLive: "assertive", ariaLabel: t("asks"), hidden: true },
    h("div", { className: "prompt-words" }, h("p", { className: "eyebrow" }, icon("user"), t("asks")), h("h2", { id: "question-head", className: "gone" }, t("asks")), question, original, entry,
      h("div", { className: "answers" }, often), arming, wrong), picture);

  async function answer(verb, because = reason.value) {
    const id = armed;
    if (verb === "confirm" && run.prompt && run.prompt.entry && run.prompt.entry.needed && !typed.value.trim()) { typed.focus(); return; }
    if (!id) return;  // not armed yet, or answered: a second click is no second answer
    armed = ""; dress();
    try { await ask("POST", `/runs/${run.id}/prompts/${id}/${verb}`, answered(verb, because), moving()); }
    catch (error) {
      const late = error.code === NOT_ASKED;
      if (late && verb !== "abort") { card.dispatchEvent(new CustomEvent("late")); return; }
      if (!late && asked === id) armed = id;
      throw error;
    }
  }

  // What is confirmed, in the words of the question.
  const confirmWords = (prompt) => { const [what, one, other] = (prompt.picture || "").split("/again/")[0].split("/"); return KEYS.includes(`done_${what}`) ? t(`done_${what}`, { one, other }) : t("answer_confirm"); };
  // What is typed goes with confirm alone; Enter types another row, so that a pasted one answers nothing by itself.
  const answered = (verb, because) => ({ reason: because, ...(verb === "confirm" && run.prompt && run.prompt.entry && typed.value.trim() ? { typed: typed.value } : {}) });

  function askNumbers(numbers, already, drives) {
    entry.hidden = !numbers;
    if (!numbers) return;
    typed.value = already;
    shown.textContent = numbers.shown.map((value, i) => `${numbers.names[i]}\u00a0${value}`).join("   "); shown.hidden = !numbers.shown.length;
    stopless.textContent = drives ? t("byHand") : "";
    entryName.textContent = t("typedHere", { unit: numbers.unit, names: numbers.names.join(" ") });
    typed.setAttribute("aria-label", entryName.textContent);
  }

  function dress() {
    const prompt = run && run.prompt;
    if (!prompt) return;
    arming.textContent = looksOn() ? t("operatorAnswers") : armed ? "" : t("arming");
    for (const each of buttons) {
      if (each.id === "confirm") each.textContent = confirmWords(prompt);
      if (each.id === "redo") each.textContent = t((prompt.picture || "").startsWith("moved/") ? "answer_redo_since" : "answer_redo");
      each.hidden = !prompt.expects.includes(each.dataset.answer); each.disabled = connection.silent || looksOn();
      const empty = Boolean(each.id === "confirm" && prompt.entry && prompt.entry.needed && !typed.value.trim());
      each.setAttribute("aria-disabled", String(!armed || empty));
    }
  }

  // Another view makes the card anew: what has been typed for a prompt outlives it, and no other prompt gets it.
  function keepDraft() { desk.draft = { run: run.id, prompt: asked, typed: typed.value, reason: reason.value }; }
  const draftOf = (prompt) => (desk.draft && desk.draft.run === run.id && desk.draft.prompt === prompt.id ? desk.draft : { typed: "", reason: "" });

  typed.addEventListener("input", () => { keepDraft(); dress(); });
  reason.addEventListener("input", keepDraft);

  card.answer = answer;
  card.show = (of, scene) => {
    run = of;
    const prompt = run && run.prompt;
    card.hidden = !prompt;
    if (!prompt) { asked = armed = ""; drawn = null; return; }
    const fresh = asked !== prompt.id;
    if (fresh) {
      const mine = promptWords(prompt);  // short; the service says it with all figures
      asked = prompt.id; armed = ""; reason.value = draftOf(prompt).reason; wrong.open = Boolean(reason.value);
      question.textContent = mine || prompt.text;
      original.textContent = mine && mine !== prompt.text && !SAME.test(prompt.text) ? prompt.text : "";
      askNumbers(prompt.entry, draftOf(prompt).typed, /^(drive|pendant)/.test(prompt.picture || ""));
      setTimeout(() => { if (asked === prompt.id) { armed = asked; dress(); } }, ARMED_MS);
    }
    if (drawn !== prompt.id && (scene || !prompt.picture)) { drawn = prompt.id; picture.replaceChildren(...[promptPicture(prompt, scene)].filter(Boolean)); }
    dress();
    if (fresh && desk.cell) card.focus();
  };
  return card;
}
