"use strict";
// Runs a Node-RED flow of inject, function, http request and debug nodes, as far as examples/cell-pc/flow.json needs it.
// node node_red.js FLOW.json CAMPAIGN.json: starts it, beats once, prints what debug nodes get; ends with the result.
const fs = require("fs");
const nodes = JSON.parse(fs.readFileSync(process.argv[2], "utf8"));
const byId = Object.fromEntries(nodes.map((node) => [node.id, node]));
const store = {};
const flow = { get: (key) => store[key], set: (key, value) => { store[key] = value; } };
const env = { get: (key) => process.env[key] };

function fail(text) {
  console.error(text);
  process.exit(1);
}

async function send(wires, messages) {
  await Promise.all(wires.map((targets, i) => messages[i] && Promise.all(targets.map((id) => receive(byId[id], { ...messages[i] })))));
}

async function receive(node, msg) {
  if (node.type === "inject") return send(node.wires, [msg]);
  if (node.type === "debug") {
    console.log(`${node.id}: ${JSON.stringify(msg.payload)}`);
    if (node.id === "result") process.exit(0);
    if (node.id === "prompt") return receive(byId.yes, {});
    return undefined;
  }
  if (node.type === "function") {
    const about = { error: fail, status: () => {} };
    const out = new Function("msg", "node", "flow", "env", node.func)(msg, about, flow, env);
    return out && send(node.wires, Array.isArray(out) ? out : [out]);
  }
  const body = msg.method === "GET" || msg.payload === "" ? undefined : JSON.stringify(msg.payload);
  const answer = await fetch(msg.url, { method: msg.method, headers: msg.headers, body });
  const text = await answer.text();
  return send(node.wires, [{ ...msg, statusCode: answer.status, payload: text && JSON.parse(text) }]);
}

receive(byId.go, { payload: JSON.parse(fs.readFileSync(process.argv[3], "utf8")) }).catch((error) => fail(String(error)));
const beat = setInterval(() => { if (store.lease) { clearInterval(beat); receive(byId.beat, {}); } }, 200);
