// The viewer: state, controls, and one repaint a frame at most.

const LEAST_DOLP = 0.005; // below, an angle of polarisation is noise
const DEGREES_A_SECOND = 45;
const COLOUR = "colour";  // in place of a band: all of them, as the eye sees them
const LUMINANCE = [0.2126, 0.7152, 0.0722]; // of linear sRGB (IEC 61966-2-1)

class Viewer {
  constructor(root, data) {
    this.root = root;
    this.data = data;
    this.view = new View();
    this.angle = 0;
    this.wanted = new Set();
    this.find = (id) => root.querySelector("#" + id);
    this.curve = screenCurve();
    this.tables = {
      grey: Uint32Array.from(this.curve, (code) => packed(code, code, code)),
      diverging: tableOf(data.tables.diverging, false),
      sequential: tableOf(data.tables.sequential, false),
      cyclic: tableOf(data.tables.cyclic, true),
    };
    this.panels = {};
    for (const figure of root.querySelectorAll("figure[data-panel]")) {
      const panel = new Panel(figure, this.view);
      this.panels[figure.dataset.panel] = panel;
      linkPointers(panel, this.view, () => this.ask("draw"), (pixel) => this.pick(pixel));
    }
    this.readout = new Readout(this.find("readout"));
    this.legends();
    this.listen();
    this.chooseScene();
  }

  legends() {
    for (const bar of this.root.querySelectorAll("canvas[data-table]")) {
      const table = this.tables[bar.dataset.table];
      bar.width = table.length;
      bar.height = 1;
      const context = bar.getContext("2d"), image = context.createImageData(table.length, 1);
      new Uint32Array(image.data.buffer).set(table);
      context.putImageData(image, 0, 0);
    }
    for (const wheel of this.root.querySelectorAll("canvas.wheel")) drawWheel(wheel, this.tables.cyclic);
  }

  listen() {
    const fill = (id, change) => this.find(id).addEventListener("change", change);
    this.find("scene").replaceChildren(
      ...this.data.scenes.map((scene, i) => new Option(scene.label, i)));
    fill("scene", () => this.chooseScene());
    fill("method", () => this.load());
    fill("band", () => this.load());
    this.find("angle").addEventListener("input", (event) => {
      this.play(false);
      this.turn(Number(event.target.value));
    });
    this.find("exposure").addEventListener("input", () => this.ask("paint"));
    this.find("unmixed").addEventListener("change", () => this.choosePixels());
    this.find("off-mask").addEventListener("change", () => this.cover());
    this.find("play").addEventListener("click", () => this.play(!this.playing));
    this.find("zoom-in").addEventListener("click", () => this.zoom(1.5));
    this.find("zoom-out").addEventListener("click", () => this.zoom(1 / 1.5));
    this.find("zoom-reset").addEventListener("click", () => this.zoom(0));
    this.root.addEventListener("keydown", (event) => this.key(event));
    new ResizeObserver(() => this.ask("draw")).observe(this.panels.truth.canvas);
  }

  key(event) {
    const target = event.target;
    if (event.ctrlKey || event.metaKey || event.altKey || target.matches("select, #exposure")) return;
    const step = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
    const actions = {
      ArrowLeft: () => this.turn(this.angle - 1), ArrowRight: () => this.turn(this.angle + 1),
      ArrowDown: () => this.turn(this.angle - 1), ArrowUp: () => this.turn(this.angle + 1),
      PageDown: () => this.turn(this.angle - 10), PageUp: () => this.turn(this.angle + 10),
      Home: () => this.turn(0), End: () => this.turn(180),
      "+": () => this.zoom(1.5), "-": () => this.zoom(1 / 1.5), 0: () => this.zoom(0),
    };
    if (!target.matches("button, [type=checkbox]")) actions[" "] = () => this.play(!this.playing);
    let action = actions[event.key];
    if (event.shiftKey && step[event.key]) action = () => this.step(...step[event.key]);
    if (!action) return;
    event.preventDefault();
    action();
  }

  chooseScene() {
    const scene = this.scene = this.data.scenes[Number(this.find("scene").value)];
    const keep = (id, options) => {
      const select = this.find(id), before = select.value;
      select.replaceChildren(...options);
      if ([...select.options].some((option) => option.value === before)) select.value = before;
    };
    keep("method", Object.keys(scene.methods).map((name) => new Option(name, name)));
    const bands = scene.bands.map((name, i) => new Option(name, i));
    const [red, green, blue] = scene.colours.map(String);
    const name = red === green && green === blue ? "all, as grey" : "all, in colour";
    if (scene.colours[0].length > 1) bands.unshift(new Option(name, COLOUR));
    keep("band", bands);
    const better = ["eq8", ...Object.keys(scene.methods)].find(
      (name) => name !== "unpolarised" && scene.methods[name]);
    if (this.find("method").value === "unpolarised" && better) this.find("method").value = better;
    const mixed = this.mixed = mixedOf(scene);
    this.find("unmixed").closest(".unmixed").hidden = !mixed.size;
    this.find("unmixed-text").textContent =
      `Leave out ${mixed.size} pixel${mixed.size === 1 ? "" : "s"} of several normals`;
    this.beyond = {
      ...scene.beyond,
      at: positionsOf(scene.beyond.mask, scene.beyond.pixels, scene.width * scene.height),
    };
    this.object = positionsOf(scene.mask, scene.pixels, scene.width * scene.height);
    this.view.reset();
    this.view.locked = false;
    this.choosePixels();
    const first = this.at[largestOf(this.truth.stokes[0])] || 0;
    this.view.pick = { x: first % scene.width, y: Math.floor(first / scene.width) };
  }

  /** All pixels of the object, or only those that see one normal. */
  choosePixels() {
    const { scene, mixed, object: all } = this;
    const without = this.find("unmixed").checked && mixed.size > 0;
    this.shown = without ? Uint32Array.from(all.keys()).filter((i) => !mixed.has(i)) : null;
    this.at = this.shown ? this.shown.map((i) => all[i]) : all;
    this.where = new Int32Array(scene.width * scene.height).fill(-1);
    this.at.forEach((place, i) => { this.where[place] = i; });
    Object.values(this.panels).forEach((panel) => panel.resize(scene.width, scene.height));
    this.cover();
    this.load();
  }

  /** Hatch what is off the mask, where that is asked for. */
  cover() {
    this.view.cover = this.find("off-mask").checked
      ? hatched(this.object, this.scene.width, this.scene.height) : null;
    this.ask("draw");
  }

  /**
   * Light of the chosen band, or of all: its planes as they are stored, Stokes planes, and those of
   * red, green and blue where it has a colour.
   */
  lightOf(stored, pixels, truth) {
    const band = this.find("band").value, { colours } = this.scene;
    const planes = (k) => stokesOf(stored[k], pixels, truth?.planes[k]);
    if (band !== COLOUR) return { planes: { [band]: planes(band) }, stokes: planes(band) };
    const used = stored.map((_, k) => k).filter((k) => colours.some((weights) => weights[k]));
    const all = Object.fromEntries(used.map((k) => [k, planes(k)]));
    const channels = colours.map((weights) =>
      weighed(used.map((k) => all[k]), used.map((k) => weights[k])));
    return { planes: all, channels, stokes: weighed(channels, LUMINANCE) };
  }

  /** Light of those of the object's pixels that are shown. */
  ofShown(light) {
    if (!this.shown) return light;
    const chosen = (stokes) =>
      stokes.map((plane) => Float32Array.from(this.shown, (i) => plane[i]));
    return { stokes: chosen(light.stokes), channels: light.channels?.map(chosen) };
  }

  load() {
    const { scene } = this, method = this.find("method").value, pixels = scene.pixels;
    const truth = this.lightOf(scene.truth, pixels);
    this.truth = this.ofShown(truth);
    this.estimate = this.ofShown(this.lightOf(scene.methods[method], pixels, truth));
    this.around = this.lightOf(this.beyond.truth, this.beyond.pixels);
    this.unfiltered = unpolarised(this.around);
    this.difference = differenceOf(this.estimate.stokes, this.truth.stokes);
    this.white = Math.max(...(this.truth.channels || [this.truth.stokes]).map((stokes) =>
      quantile(brightest(stokes), 0.995))) || 1;
    this.spread = quantile(brightest(this.difference), 0.995) || this.white * 1e-6;
    const dolps = [this.truth.stokes, this.estimate.stokes].map((s) =>
      quantile(s[0].map((s0, i) => dolpOf(s0, s[1][i], s[2][i])), 0.995));
    this.largest = Math.min(1, Math.max(0.01, ...dolps));
    const score = (scene.scores || {})[method];
    const unmixed = this.mixed.size ? `, without pixels of several normals ${score?.unmixed}` : "";
    this.find("score").textContent = score
      ? `${method} on this scene, all bands and angles: NMSE ${score.nmse}, skill ${score.skill}${unmixed}` : "";
    this.root.querySelectorAll(".method-name").forEach((name) => { name.textContent = method; });
    this.paintStill();
    this.ask("paint");
  }

  /** What does not turn with the polariser. */
  paintStill() {
    const grey = packed(128, 128, 128);
    for (const [name, light] of [["truth", this.truth], ["estimate", this.estimate]]) {
      const dolp = this.panels["dolp-" + name], aolp = this.panels["aolp-" + name];
      const around = name === "truth" ? this.around : this.unfiltered;
      for (const [at, { stokes }] of [[this.at, light], [this.beyond.at, around]]) {
        paintDolp(dolp.pixels, at, stokes, this.largest, this.tables.sequential);
        paintAolp(aolp.pixels, at, stokes, LEAST_DOLP, grey, this.tables.cyclic);
      }
      dolp.paint();
      aolp.paint();
    }
    const percent = number(100 * this.largest) + " %";
    this.root.querySelectorAll(".dolp-most").forEach((label) => { label.textContent = percent; });
    this.find("diff-least").textContent = "−" + number(this.spread);
    this.find("diff-most").textContent = "+" + number(this.spread);
  }

  /** Ask for new colours ("paint"), a new view of all panels ("draw"), or both at the next frame. */
  ask(what) {
    this.wanted.add(what);
    this.frame ||= requestAnimationFrame(() => {
      this.frame = 0;
      const { wanted } = this;
      this.wanted = new Set();
      if (wanted.has("paint")) this.paint();
      if (wanted.has("draw")) Object.values(this.panels).forEach((panel) => panel.draw());
      this.tell();
    });
  }

  paint() {
    const { truth, estimate, difference } = this.panels, top = LEVELS - 1;
    const white = this.white / 2 ** Number(this.find("exposure").value);
    const paint = (panel, at, { stokes, channels }) => {
      if (channels) paintColour(panel.pixels, at, channels, this.angle, top / white, this.curve);
      else paintRadiance(panel.pixels, at, stokes, this.angle, top / white, 0, this.tables.grey);
    };
    paint(truth, this.at, this.truth);
    paint(truth, this.beyond.at, this.around);
    paint(estimate, this.at, this.estimate);
    paint(estimate, this.beyond.at, this.unfiltered);
    paintRadiance(difference.pixels, this.at, this.difference, this.angle,
      top / 2 / this.spread, top / 2, this.tables.diverging);
    [truth, estimate, difference].forEach((panel) => panel.paint());
    this.root.querySelectorAll(".white").forEach((label) => { label.textContent = number(white); });
    this.root.dataset.white = white;
  }

  tell() {
    const { x, y } = this.view.pick, i = this.where[y * this.scene.width + x];
    if (i < 0) this.readout.nothing("This pixel is off the mask: no method is scored there");
    else {
      const pixel = ({ stokes }) => stokes.map((plane) => plane[i]);
      const note = this.truth.channels ? ", all bands as the eye weighs them" : "";
      this.readout.show(this.view.pick, this.scene.step, pixel(this.truth), pixel(this.estimate),
        this.angle, note);
    }
    this.root.dataset.shown = this.angle;
  }

  pick(pixel) {
    this.view.pick = pixel;
    this.ask("draw");
  }

  step(x, y) {
    const { pick } = this.view, { width, height } = this.scene;
    this.view.locked = true;
    this.pick({
      x: Math.min(width - 1, Math.max(0, pick.x + x)),
      y: Math.min(height - 1, Math.max(0, pick.y + y)),
    });
  }

  turn(degrees) {
    this.angle = Math.min(180, Math.max(0, degrees));
    const slider = this.find("angle"), text = this.angle.toFixed(1).replace(/\.0$/, "") + "°";
    slider.value = this.angle;
    slider.setAttribute("aria-valuetext", text + " anticlockwise from the vertical");
    this.find("angle-text").textContent = text;
    this.find("axis").setAttribute("transform", `rotate(${-this.angle})`);
    this.ask("paint");
  }

  zoom(factor) {
    if (factor) this.view.zoomBy(factor, 0.5, 0.5);
    else this.view.reset();
    this.ask("draw");
  }

  play(on) {
    this.playing = on;
    const button = this.find("play");
    button.setAttribute("aria-pressed", String(on));
    button.textContent = on ? "❚❚ Stop" : "▶ Play";
    if (!on) return;
    let before = performance.now();
    const next = (now) => {
      if (!this.playing) return;
      this.turn((this.angle + (now - before) / 1000 * DEGREES_A_SECOND) % 180);
      before = now;
      requestAnimationFrame(next);
    };
    requestAnimationFrame(next);
  }
}

/** What a camera without a polariser knows of light: all of it, and no polarisation. */
function unpolarised({ stokes, channels }) {
  const plain = ([s0]) => [s0, new Float32Array(s0.length), new Float32Array(s0.length)];
  return { stokes: plain(stokes), channels: channels?.map(plain) };
}

/** Stripes, dark and bright in turn, over all pixels but those of a mask. */
function hatched(mask, width, height) {
  const canvas = document.createElement("canvas");
  canvas.width = width;
  canvas.height = height;
  const context = canvas.getContext("2d"), image = context.createImageData(width, height);
  const out = new Uint32Array(image.data.buffer);
  out.forEach((_, i) => {
    const stripe = (i % width + Math.floor(i / width)) % 6 < 3;
    out[i] = (stripe ? packed(20, 20, 24) & 0xb0ffffff : packed(235, 235, 240) & 0xb0ffffff) >>> 0;
  });
  mask.forEach((place) => { out[place] = 0; });
  context.putImageData(image, 0, 0);
  return canvas;
}

/** The legend of angles: the colour at a place on the rim is that of its direction. */
function drawWheel(canvas, table) {
  const size = canvas.width, context = canvas.getContext("2d");
  const image = context.createImageData(size, size);
  const out = new Uint32Array(image.data.buffer), middle = (size - 1) / 2;
  for (let y = 0; y < size; y++) {
    for (let x = 0; x < size; x++) {
      const r = Math.hypot(x - middle, y - middle) / middle;
      if (r > 1 || r < 0.45) continue;
      const angle = (Math.atan2(middle - y, x - middle) * 180 / Math.PI + 360) % 180;
      out[y * size + x] = table[Math.floor(angle / 180 * table.length) % table.length];
    }
  }
  context.putImageData(image, 0, 0);
}
