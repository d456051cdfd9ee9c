// Step 6, Verify: the proof on the robot, at new poses, without and with the correction.

import { ask } from "./connection.js";
import { desk, looksOn } from "./desk.js";
import { headline, nothingYet } from "./diagnose.js";
import { card, fill, fold, footBar, h, head, numeric, table } from "./dom.js";
import { open as measuring } from "./measure.js";
import { active, addressOf, findRun, road, stageOf, walk } from "./road.js";
import { bars } from "./charts.js";
import { number } from "./units.js";
import { t } from "./words.js";

export function open(root, id) {
  if (!id) return nothingYet(root, 6);
  const title = h("h1", { id: "title" }, t("view_of_verify")), says = h("p", { className: "lead", role: "status" }), body = h("div", { className: "stack" }), foot = footBar(t("next"));
  root.append(head(t("stepOf", { n: 6 }), title, says), body, foot);
  let job = null, inner = null, run = "";

  function show() {
    if (inner) { inner.show(); return; }
    if (!job) return;
    const v = job.result && job.result.verification;
    title.textContent = !v ? t("view_of_verify") : v.error_uncorrected_mm && v.error_verified_mm.rms >= v.error_uncorrected_mm.rms ? t("notBetter") : t("provenTitle");
    says.textContent = v ? "" : active(job) ? job.step || "" : t("proofHow");
    fill(body, [Boolean(v), job.state], () => (v ? sheet(v) : []));
    foot.set([Boolean(v), active(job), Boolean(job.report), looksOn()], v ? t("next_report") : active(job) ? t("loopGoesOn") : t("next_proof"), () => (v ? [desk.cell && h("a", { className: "btn", href: "#/prepare" }, t("newCalibration")), h("a", { className: "btn primary", id: "open-report", href: `#/report/${id}` }, t("openReport"))].filter(Boolean)
      : active(job) ? [] : [job.report && h("a", { className: "btn", id: "open-report", href: `#/report/${id}` }, t("openReport")), desk.cell && !looksOn() && h("a", { className: "btn primary", id: "to-proof", href: road.plan ? addressOf("check") : "#/prepare" }, t("measureWithProof"))].filter(Boolean)));
  }

  function sheet(v) {
    const r = job.result, rows = [[t("rungUncorrected"), v.error_uncorrected_mm, "before"], [t("rungVerified"), v.error_verified_mm, "after"]].filter(([, errors]) => errors);
    const expected = r.error_after_mm || r.error_before_mm, from = v.error_uncorrected_mm ? v.error_uncorrected_mm.rms : (r.error_nominal_mm || v.error_verified_mm).rms;
    return [h("div", { className: "cols c7-5 sheet" }, h("section", { className: "card answer-card" }, headline(from, v.error_verified_mm.rms, t("proofCaption", { n: v.poses })),
      h("div", { className: "accept" }, h("dl", {}, h("div", {}, h("dt", {}, t("measured")), h("dd", {}, `${number(v.error_verified_mm.rms)} mm`), expected ? h("dd", { className: "sub" }, t("diagnosisSaid", { mm: number(expected.rms) })) : null),
        h("div", {}, h("dt", {}, t("bestPossible")), h("dd", {}, `${number(v.floor_rms_mm)} mm`), h("dd", { className: "sub" }, t("noiseOf")))),
      ), bars(t("proofBars"), rows.map(([name, errors, kind]) => [name, errors.rms, `${number(errors.rms)} mm`, kind]))),
    card(t("whatNext"), h("p", {}, t("keepItSo")), (r.effects || []).map((each) => each.check).filter(Boolean).map((each) => h("p", {}, typeof each === "string" ? each : each.text || "")), h("a", { href: "#/robots", className: "do" }, t("planWatch")))),
    fold(t("allFigures"), t("allFiguresNote"), table(t("proofBars"), [t("model"), "n", t("mean"), "RMS", "95 %", t("most")], rows.map(([name, errors]) => [name, numeric(String(errors.n)), ...["mean", "rms", "p95", "max"].map((each) => numeric(number(errors[each])))])), v.refused.length ? h("p", {}, `${t("refusedTargets")}: ${v.refused.join(", ")}`) : null, h("p", { className: "sub" }, v.approach))];
  }

  async function look() {
    if (!job || active(job)) {
      job = await ask("GET", `/results/${id}`);
      walk({ job: active(job) && job.kind === "loop" ? null : job, ...(job.kind === "loop" ? { loop: job } : {}) });
      await findRun(job);
    }
    const driving = active(job) && job.kind === "loop" && stageOf(job) === 5 && job.run_id;
    if (driving && run !== driving) {  // the run of the proof, in the place of the sheet
      if (inner) inner.close();
      run = driving; root.replaceChildren(); inner = measuring(root, run, 6);
    } else if (!driving && inner) {
      inner.close(); inner = null;
      root.replaceChildren(head(t("stepOf", { n: 6 }), title, says), body, foot);
    }
    if (inner) await inner.look(); else show();
  }
  return { look, show, close: () => { if (inner) inner.close(); }, shown: () => run };
}
