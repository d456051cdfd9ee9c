"use strict";
// What a run gave: its data sets, what was found in them, and the files of both.

const COLLECTIONS = { identification: "identifications", diagnosis: "diagnoses" }, COLLECT_MS = 10000;
let given = null, collected = { key: "", at: 0 };

const inHand = (job) => ["ready", "running"].includes(job.state);

async function collect(now = false) {
  const of = run;
  if (!of || of.dry_run || !["succeeded", "failed"].includes(of.state)) { given = null; showGiven(); return; }
  const key = `${of.id} ${of.version}`, known = given && collected.key === key && Date.now() - collected.at < COLLECT_MS;
  if (known && !now && !given.jobs.some(inHand)) { showGiven(); return; }
  const [{ datasets }, { loops }] = await Promise.all([ask("GET", "/datasets"), ask("GET", "/loops")]);
  const loop = loops.find((each) => each.runs.includes(of.id)) || null;
  const own = datasets.filter((each) => each.run_id === of.id || (loop && each.id === loop.dataset_id));
  const lists = await Promise.all(own.map((each) => ask("GET", `/datasets/${each.id}/jobs`)));
  if (chosen !== of.id) return;
  given = { run: of.id, datasets: own, loop, jobs: lists.flatMap((each) => each.jobs) };
  collected = { key, at: Date.now() };
  showGiven();
}

// A link cannot send a token: the file is fetched with it, and then saved.
function link(text, path, name) {
  const made = Object.assign(document.createElement("a"), { textContent: text, href: API + path });
  made.addEventListener("click", (event) => { event.preventDefault(); order(() => save(path, name)); });
  return made;
}

async function save(path, name) {
  const url = URL.createObjectURL(await reach(path, { headers: bearer() }, ORDER_MS, (answer) => answer.blob()));
  Object.assign(document.createElement("a"), { href: url, download: name }).click();
  setTimeout(() => URL.revokeObjectURL(url), 60000);
}

function begin(text, collection, dataset) {
  const made = Object.assign(document.createElement("button"), { type: "button", textContent: text, hidden: looksOn() });
  made.addEventListener("click", () => order(async () => {
    await ask("POST", `/${collection}`, { dataset_id: dataset }, key());
    await collect(true);
  }));
  return made;
}

function results(id) {
  return [link("report", `/reports/${id}`, `${id}-report.html`), link("model", `/models/${id}`, `${id}-model.json`)];
}

function rowOfJob(job) {
  const text = `${words(job.kind)} of ${clock(new Date(job.created_utc), 5)}: ${words(job.state)}`;
  if (job.problem) return [`${text}. ${job.problem.operator_text} ${job.problem.what_to_do}`];
  if (job.state !== "succeeded" || !COLLECTIONS[job.kind]) return [text];
  const [report, model] = results(job.id);
  return job.result.converged ? [text, report, model] : [`${text}, but it has not converged: no model`, report];
}

function rowOfDataset(data) {
  return [`data set ${data.name}, ${data.readings} readings`,
    link("data.csv", `/datasets/${data.id}/data.csv`, `${data.id}.csv`), link("data.toml", `/datasets/${data.id}/data.toml`, `${data.id}.toml`),
    begin("Identify", COLLECTIONS.identification, data.id), begin("Diagnose", COLLECTIONS.diagnosis, data.id)];
}

function showGiven() {
  $("given").hidden = !given;
  $("export").hidden = looksOn() || Boolean(given && given.datasets.length);
  const shown = JSON.stringify([given, looksOn()]);
  if ($("files").dataset.shown === shown) return;  // what has the focus stays
  $("files").dataset.shown = shown;
  const rows = !given ? [] : [
    ...(given.loop && given.loop.report ? [["closed loop", ...results(given.loop.id)]] : []),
    ...given.jobs.map(rowOfJob), ...given.datasets.map(rowOfDataset),
    ["record", link("events.jsonl", `/runs/${given.run}/events.jsonl`, `${given.run}-events.jsonl`)],
  ];
  $("files").replaceChildren(...rows.map((parts) => {
    const line = document.createElement("li");
    line.replaceChildren(...parts);
    return line;
  }));
}
