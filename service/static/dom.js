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
// name it comes back where it had to be made anew.
export function fill(place, shown, nodes) {
  const key = JSON.stringify(shown);
  if (place.dataset.shown === key) return;
  place.dataset.shown = key;
  const here = document.activeElement, name = place.contains(here) && here.dataset.name;
  place.replaceChildren(...[nodes()].flat(Infinity).filter(Boolean));
  const again = name && [...place.querySelectorAll("[data-name]")].find((each) => each.dataset.name === name);
  if (again) again.focus({ preventScroll: true });
}

export const button = (text, act, props = {}) => h("button", { type: "button", ...props, on: { click: act } }, text);

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
