// Nodes made from values. Whatever comes from the service is text: nothing here reads markup.

const SVG = "http://www.w3.org/2000/svg";

function make(node, props, children) {
  for (const [name, value] of Object.entries(props || {})) {
    if (value === null || value === undefined || value === false) continue;
    if (name === "on") for (const [event, act] of Object.entries(value)) node.addEventListener(event, act);
    else if (name in node && !["list", "form", "role"].includes(name) && node.namespaceURI !== SVG) node[name] = value;
    else node.setAttribute(name === "className" ? "class" : name, value === true ? "" : value);
  }
  node.append(...children.flat(Infinity).filter((child) => child !== null && child !== undefined && child !== false));
  return node;
}

export const h = (tag, props, ...children) => make(document.createElement(tag), props, children);
export const svg = (tag, props, ...children) => make(document.createElementNS(SVG, tag), props, children);
export const $ = (id) => document.getElementById(id);
export const wait = (ms) => new Promise((go) => setTimeout(go, ms));

// Shows `nodes()` in a place, made anew only when what they show has changed: what has the focus stays, and by its
// name or id it comes back where it had to be made anew.
export function fill(place, shown, nodes) {
  const key = JSON.stringify(shown);
  if (place.dataset.shown === key) return;
  place.dataset.shown = key;
  const here = document.activeElement, name = place.contains(here) && (here.dataset.name || here.id);
  place.replaceChildren(...[nodes()].flat(Infinity).filter(Boolean));
  const again = name && [...place.querySelectorAll("[data-name], [id]")].find((each) => (each.dataset.name || each.id) === name);
  if (again) again.focus({ preventScroll: true });
}

// 24 px, one stroke.
const ICONS = {
  check: "M5 12.5l4.5 4.5L19 7.5", arrow: "M5 12h14M13 6l6 6-6 6", more: "M5 12h.01M12 12h.01M19 12h.01", info: "M12 21a9 9 0 1 0 0-18 9 9 0 0 0 0 18zM12 11v5.5M12 7.5h.01",
  close: "M6 6l12 12M18 6L6 18", alert: "M12 4L2.8 20h18.4L12 4zM12 10v4.5M12 17.2h.01", stop: "M8.2 3h7.6L21 8.2v7.6L15.8 21H8.2L3 15.8V8.2z", pause: "M9 6v12M15 6v12", play: "M8 5.5v13l10.5-6.5z",
  user: "M12 12a4 4 0 1 0 0-8 4 4 0 0 0 0 8zM4.5 20c1.2-3.6 4-5.3 7.5-5.3s6.3 1.7 7.5 5.3", robot: "M5 20h8M9 20v-4.5l-2.5-6L12 5l5 3.5 2 3.5M12 5.2a.6.6 0 1 0 0-.1M6.6 9.6a.6.6 0 1 0 0-.1M17 8.6a.6.6 0 1 0 0-.1",
  tracker: "M12 13l-5 8M12 13l5 8M12 13v6M9 6.5h6v5H9zM15 9l6-3", air: "M10 14.5V5a2 2 0 1 1 4 0v9.5a4 4 0 1 1-4 0z", chevron: "M8 10l4 4 4-4", print: "M7 9V4h10v5M7 17H4.5V9.5h15V17H17M7 14h10v6H7z",
  down: "M12 4v11M7 10.5l5 5 5-5M5 20h14", file: "M7 3.5h7l4 4v13H7zM14 3.5v4h4", again: "M19 12a7 7 0 1 1-2.2-5.1M19 4v4h-4", skip: "M6 6l8 6-8 6zM18 6v12", off: "M4 4l16 16M8.5 8.6A6.5 6.5 0 0 0 5.6 10M2.5 7a12 12 0 0 1 3.3-2.2M12 19h.01",
  target: "M12 20a8 8 0 1 0 0-16 8 8 0 0 0 0 16zM12 15a3 3 0 1 0 0-6 3 3 0 0 0 0 6z",
};
export const icon = (name) => svg("svg", { viewBox: "0 0 24 24", class: "icon", "aria-hidden": "true" }, svg("path", { d: ICONS[name] }));

// `kind`: primary (the one filled button), quiet, danger; `ic`: its icon.
export const button = (text, act, { ic, kind = "", className = "", ...props } = {}) => h("button", { type: "button", className: `btn ${kind} ${className}`.trim(), ...props, on: { click: act } }, ic && icon(ic), h("span", {}, text));
export const card = (title, ...inside) => h("section", { className: "card" }, title && h("h2", {}, title), ...inside);
export const fold = (title, note, ...inside) => h("details", { className: "fold" }, h("summary", {}, icon("chevron"), h("span", { className: "what" }, title), note && h("span", { className: "note" }, note)), h("div", { className: "in" }, ...inside));
export const fact = (name, value, sub) => h("div", { className: "fact" }, h("dt", {}, name), h("dd", {}, value), sub && h("dd", { className: "sub" }, sub));
export const badge = (kind, text) => h("span", { className: `badge ${kind}` }, icon({ ok: "check", bad: "close", open: "alert" }[kind]), text);
export const noteBox = (kind, ic, strong, ...rest) => h("div", { className: `note-box ${kind}` }, icon(ic), h("div", {}, h("strong", {}, strong), ...rest));

// The head of a step: its number, one sentence, and the menu.
export const head = (eyebrow, title, lead, extra) => h("div", { className: "head" }, h("div", {}, h("p", { className: "eyebrow" }, eyebrow), title, lead), extra);

// The bar at the foot of a view, with `set(shown, says, buttons)`: what comes next in words, and the one filled button last.
export function footBar(label) {
  const says = h("p", { id: "next" }), acts = h("div", { className: "acts" }), bar = h("div", { className: "bar", role: "region", ariaLabel: label }, says, acts);
  bar.set = (shown, text, buttons) => { if (says.textContent !== text) says.textContent = text; fill(acts, shown, buttons); bar.hidden = !text && !acts.childElementCount; };
  return bar;
}

export function table(caption, heads, rows) {
  const right = (value) => typeof value === "number" || Boolean(value && value.numeric !== undefined);
  const cell = (value, i) => {
    const content = value && value.numeric !== undefined ? value.numeric : value;
    return i ? h("td", { className: right(value) ? "n" : null }, content ?? "–") : h("th", { scope: "row" }, content ?? "–");
  };
  return h("div", { className: "scroll", tabIndex: 0, role: "group", ariaLabel: caption },
    h("table", {}, h("caption", {}, caption), h("thead", {}, h("tr", {}, heads.map((each, i) => h(each ? "th" : "td", { scope: each ? "col" : null, className: i && rows.length && rows.every((row) => right(row[i])) ? "n" : null }, each)))),
      h("tbody", {}, rows.map((row) => h("tr", {}, row.map(cell))))));
}

export const numeric = (text) => ({ numeric: text });
