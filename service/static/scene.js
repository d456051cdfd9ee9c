// The cell in space, by three.js: robot, boxes, poses, their path, and errors as arrows. Lengths mm, world frame, z up.
// All pictures share one WebGL context; where the browser has none, words say so and the poses are listed instead.

import { button, h } from "./dom.js";
import { t } from "./words.js";

const VIEWS = { oblique: [0.9, -1.2, 0.75], front: [0, -1, 0.001], side: [1, 0, 0.001], top: [0, -0.001, 1] }, SLACK_PX = 5, WORST = 12;
let engine = null;  // {THREE, OrbitControls, renderer}; null in a browser without WebGL

const loaded = () => loaded.once ??= (async () => {
  if (!document.createElement("canvas").getContext("webgl2")) return;
  const [THREE, { OrbitControls }] = await Promise.all([import("three"), import("./vendor/OrbitControls.js")]);
  try { engine = { THREE, OrbitControls, renderer: new THREE.WebGLRenderer({ antialias: true, alpha: true }) }; } catch { engine = null; }
})();

// Times 1, 2 or 5 and a power of ten, so that the longest arrow is drawn 60 to 150 mm long.
export function enlargement(longest) {
  const most = 150 / longest, ten = 10 ** Math.floor(Math.log10(most));
  return ten * [5, 2, 1].find((each) => each * ten <= most);
}

const token = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();

// `show(model)`: capsules, obstacles, nests_mm, station_mm as /cell/scene has them; path_mm; marks: [{at, shape, square, label,
// id, tip, chosen}]; arrows: [{at, by}], drawn `enlarged` times; says. `pick(id)`: a pose was chosen.
export function scenePicture(name, pick = null) {
  const canvas = h("canvas", { className: "scene", role: "img", ariaLabel: name, tabIndex: 0 }), words = h("div", { className: "labels", "aria-hidden": "true" }), tip = h("div", { className: "tip", hidden: true });
  const says = h("figcaption", { className: "cap" }), listed = h("div", { className: "no3d", hidden: true });
  const tools = h("div", { className: "tools", role: "group", ariaLabel: t("turnPicture") }, Object.keys(VIEWS).map((which) => button(t(`view_${which}`), () => look(which), { className: "chip", ariaLabel: t("viewNamed", { view: t(`view_${which}`) }) })),
    [["−", "farther", 1.25], ["+", "closer", 0.8]].map(([sign, what, by]) => button(sign, () => { camera.position.sub(controls.target).multiplyScalar(by).add(controls.target); controls.update(); }, { className: "chip", ariaLabel: t(what) })));
  const stage = h("div", { className: "stage" }, canvas, words, tip, tools), figure = h("figure", { className: "space" }, stage, listed, says);
  let model = null, space = null, camera = null, controls = null, targets = [], labels = [], size = 1, down = null, middle = [0, 0, 0];

  async function draw() {
    await loaded();
    stage.hidden = !engine; listed.hidden = Boolean(engine);
    if (!engine) { list(); return; }
    const first = !space;
    build();
    if (first) { begin(); look("oblique"); }
    render();
  }

  function begin() {
    camera = new engine.THREE.PerspectiveCamera(32, 1, 0.01, 100);
    camera.up.set(0, 0, 1);
    controls = new engine.OrbitControls(camera, canvas);
    controls.listenToKeyEvents(canvas); controls.enableDamping = false; controls.keyPanSpeed = 20;
    canvas.style.touchAction = "pan-y";
    controls.addEventListener("change", render);
  }

  function look(which) {
    if (!camera) return;
    controls.target.set(...middle);
    camera.position.set(...VIEWS[which]).normalize().multiplyScalar(size * 1.7).add(controls.target);
    controls.update(); render();
  }

  function build() {
    const { THREE } = engine, m = model, vector = (p) => new THREE.Vector3(p[0] / 1000, p[1] / 1000, p[2] / 1000);
    const flat = (colour, more = {}) => new THREE.MeshLambertMaterial({ color: token(colour), ...more }), line = (colour, more = {}) => new THREE.LineBasicMaterial({ color: token(colour), ...more });
    if (space) space.traverse((each) => { each.geometry?.dispose(); });
    space = new THREE.Scene(); targets = []; labels = [];
    space.add(new THREE.HemisphereLight(0xffffff, 0x8899aa, 2.2));
    const sun = new THREE.DirectionalLight(0xffffff, 1.6); sun.position.set(1, -2, 3); space.add(sun);
    const box = new THREE.Box3(), put = (object, label) => { space.add(object); if (label) labels.push({ at: object.position, ...label }); return object; };
    const rod = (from, to, radius, material) => {
      const [a, b] = [vector(from), vector(to)], along = b.clone().sub(a), mesh = new THREE.Mesh(new THREE.CapsuleGeometry(radius / 1000, along.length(), 8, 20), material);
      mesh.position.copy(a).add(b).multiplyScalar(0.5); mesh.quaternion.setFromUnitVectors(new THREE.Vector3(0, 1, 0), along.lengthSq() ? along.normalize() : new THREE.Vector3(0, 1, 0));
      box.expandByPoint(a).expandByPoint(b); put(mesh);
    };
    const arm = flat("arm"), tool = flat("tool");
    for (const each of m.capsules || []) rod(each.from_mm, each.to_mm, each.radius_mm * (each.name.startsWith("the tool") ? 0.4 : 0.7), each.name.startsWith("the tool") ? tool : arm);
    for (const [label, place] of Object.entries(m.nests_mm || {})) {
      const ball = new THREE.Mesh(new THREE.SphereGeometry(0.014, 20, 14), flat("ink")); ball.position.copy(vector(place)); box.expandByPoint(ball.position); put(ball, { text: label });
    }
    for (const each of m.marks || []) box.expandByPoint(vector(each.at));
    for (const each of m.arrows || []) box.expandByPoint(vector(each.at));
    for (const each of m.obstacles || []) {
      if (each.kind === "box") {
        const [low, high] = [vector(each.low_mm), vector(each.high_mm)], shape = new THREE.BoxGeometry(...high.clone().sub(low).toArray()), body = new THREE.Mesh(shape, flat("ask-edge", { transparent: true, opacity: 0.35 }));
        body.position.copy(low).add(high).multiplyScalar(0.5); body.add(new THREE.LineSegments(new THREE.EdgesGeometry(shape), line("ask-edge"))); box.expandByPoint(low).expandByPoint(high); put(body);
      } else if (each.kind === "post") rod(each.from_mm, each.to_mm, each.radius_mm, flat("ask-edge"));
    }
    if (box.isEmpty()) box.expandByPoint(new THREE.Vector3(0, 0, 0)).expandByPoint(new THREE.Vector3(0.5, 0.5, 0.5));
    const wide = box.getSize(new THREE.Vector3());
    size = Math.max(0.3, wide.length()); middle = box.getCenter(new THREE.Vector3()).toArray();
    const floor = (m.obstacles || []).find((each) => each.kind === "table"), grid = new THREE.GridHelper(Math.ceil(size * 1.4 * 10) / 10, Math.ceil(size * 1.4 * 10), token("edge"), token("line"));
    grid.rotation.x = Math.PI / 2; grid.position.set(Math.round(middle[0] * 10) / 10, Math.round(middle[1] * 10) / 10, (floor ? floor.z_mm : 0) / 1000); space.add(grid);
    if ((m.path_mm || []).length) space.add(new THREE.Line(new THREE.BufferGeometry().setFromPoints(m.path_mm.map(vector)), line("mark", { transparent: true, opacity: 0.35 })));
    const r = size * 0.0085, forms = { true: new THREE.BoxGeometry(1.7 * r, 1.7 * r, 1.7 * r), false: new THREE.SphereGeometry(r, 16, 12) };
    const looks = { measured: flat("mark"), now: flat("act"), skipped: flat("stop"), planned: flat("raised"), deferred: flat("sunken"), rim: new THREE.MeshBasicMaterial({ color: token("mark"), side: THREE.BackSide }), chosen: new THREE.MeshBasicMaterial({ color: token("ink"), side: THREE.BackSide }) };
    for (const each of m.marks || []) {
      const form = forms[Boolean(each.square)], mesh = new THREE.Mesh(form, looks[each.shape] || looks.planned), rim = new THREE.Mesh(form, each.chosen || each.shape === "now" ? looks.chosen : looks.rim);
      mesh.position.copy(vector(each.at)); rim.scale.setScalar(each.chosen ? 2 : each.shape === "now" ? 1.6 : 1.25); mesh.add(rim); mesh.userData.mark = each;
      if (each.shape === "now" || each.chosen) mesh.scale.setScalar(1.3);
      targets.push(put(mesh, (each.chosen || each.shape === "now") && each.label ? { text: each.label, strong: true } : null));
    }
    const colour = token(m.after ? "after" : "before");
    for (const each of m.arrows || []) {
      const by = vector(each.by).multiplyScalar(m.enlarged || 1), long = by.length();
      if (long > 1e-6) space.add(new THREE.ArrowHelper(by.clone().normalize(), vector(each.at), long, colour, Math.min(0.03, 0.4 * long), Math.min(0.016, 0.2 * long)));
    }
    if (m.station_mm) {
      const from = new THREE.Vector3(...middle), along = vector(m.station_mm).sub(from), far = along.length();
      along.normalize();
      const ends = [0.35, 0.55].map((share) => from.clone().addScaledVector(along, Math.min(share * size, far))), beam = new THREE.Line(new THREE.BufferGeometry().setFromPoints(ends), new THREE.LineDashedMaterial({ color: token("ink-3"), dashSize: 0.02, gapSize: 0.012 }));
      beam.computeLineDistances(); space.add(beam); labels.push({ at: ends[1], text: t("stationAway", { m: far.toFixed(1) }) });
    }
  }

  function render() {
    const W = canvas.clientWidth, H = canvas.clientHeight;
    if (!space || !camera || !W || !H) return;
    const { renderer } = engine, ratio = Math.min(2, devicePixelRatio);
    renderer.setPixelRatio(ratio); renderer.setSize(W, H, false);
    camera.aspect = W / H; camera.fov = W < H * 1.2 ? 46 : 32; camera.updateProjectionMatrix();
    renderer.render(space, camera);
    canvas.width = Math.round(W * ratio); canvas.height = Math.round(H * ratio);
    canvas.getContext("2d").drawImage(renderer.domElement, 0, 0);
    words.replaceChildren(...labels.map(({ at, text, strong }) => {
      const p = at.clone().project(camera), label = h("span", { className: strong ? "strong" : "" }, text);
      label.style.left = `${Math.max(4, Math.min(W - 8 * text.length - 8, (p.x + 1) / 2 * W + 10))}px`; label.style.top = `${Math.max(0, Math.min(H - 22, (1 - p.y) / 2 * H - 10))}px`;
      return label;
    }));
  }

  function hit(event) {
    if (!engine || !camera || !targets.length) return null;
    const { THREE } = engine, at = canvas.getBoundingClientRect(), ray = new THREE.Raycaster();
    ray.setFromCamera(new THREE.Vector2((event.clientX - at.left) / at.width * 2 - 1, 1 - (event.clientY - at.top) / at.height * 2), camera);
    const [first] = ray.intersectObjects(targets);
    return first ? (first.object.userData.mark || first.object.parent.userData.mark) : null;
  }

  // Without WebGL: the poses, or the places, in words; a pose is chosen by its button.
  function list() {
    const places = Object.entries(model.nests_mm || {}).map(([each, p]) => `${each}: ${p.map((v) => v.toFixed(0)).join(", ")} mm`);
    const worst = (model.arrows || []).map(({ at, by }) => [Math.hypot(...by), at]).sort(([a], [b]) => b - a).slice(0, WORST).map(([mm, at]) => t("errorAt", { mm: mm.toFixed(3), place: at.map((v) => v.toFixed(0)).join(", ") }));
    const marks = (model.marks || []).map((each) => h("li", {}, pick && each.id !== undefined ? button(each.tip, () => pick(each.id), { className: "chip", "aria-pressed": String(Boolean(each.chosen)) }) : h("span", {}, each.tip)));
    const inner = h("ul", { className: "pose-list", ariaLabel: name, tabIndex: marks.length ? 0 : -1 }, marks.length ? marks : (worst.length ? worst : places).map((each) => h("li", {}, each)));
    const scrolled = listed.lastChild ? listed.lastChild.scrollTop : 0;
    listed.replaceChildren(h("p", {}, t("noWebGl")), inner);
    inner.scrollTop = scrolled;
  }

  canvas.addEventListener("pointerdown", (event) => { down = [event.clientX, event.clientY]; });
  canvas.addEventListener("pointerup", (event) => {
    const mark = pick && down && Math.hypot(event.clientX - down[0], event.clientY - down[1]) < SLACK_PX && hit(event);
    down = null;
    if (mark) pick(mark.id);
  });
  canvas.addEventListener("pointermove", (event) => {
    const mark = event.buttons ? null : hit(event), at = canvas.getBoundingClientRect();
    tip.hidden = !mark; canvas.classList.toggle("over", Boolean(mark && pick));
    if (mark) { tip.textContent = mark.tip || mark.label; tip.style.left = `${Math.min(event.clientX - at.left + 14, at.width - 180)}px`; tip.style.top = `${Math.max(4, event.clientY - at.top - 40)}px`; }
  });
  canvas.addEventListener("pointerleave", () => { tip.hidden = true; });
  stage.addEventListener("wheel", (event) => { if (!event.ctrlKey) event.stopImmediatePropagation(); }, { capture: true });  // the page scrolls
  new ResizeObserver(render).observe(canvas);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { if (model && figure.isConnected) draw(); });
  figure.show = (shown) => {
    model = shown;
    says.textContent = shown.says || ""; says.hidden = !shown.says;
    canvas.setAttribute("aria-label", shown.described || name);
    draw().catch((error) => console.error(error));
  };
  return figure;
}
