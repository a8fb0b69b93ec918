// One image of the viewer: pixels at their own resolution, seen through a shared window.

class Panel {
  constructor(figure, view) {
    this.canvas = figure.querySelector("canvas");
    this.figure = figure;
    this.view = view;
    this.source = document.createElement("canvas");
  }

  resize(width, height) {
    this.source.width = width;
    this.source.height = height;
    // Every frame's pixels come from the processor: a copy on a graphics card would only cost.
    this.context = this.source.getContext("2d", { willReadFrequently: true });
    this.image = this.context.createImageData(width, height);
    this.pixels = new Uint32Array(this.image.data.buffer);
    this.canvas.style.aspectRatio = width + " / " + height;
  }

  /** Show what was painted into `pixels`. */
  paint() {
    this.context.putImageData(this.image, 0, 0);
    this.draw();
  }

  draw() {
    const { canvas, source, view } = this;
    const ratio = window.devicePixelRatio || 1;
    const width = Math.max(1, Math.round(canvas.clientWidth * ratio));
    const height = Math.max(1, Math.round(canvas.clientHeight * ratio));
    if (canvas.width !== width || canvas.height !== height) {
      canvas.width = width;
      canvas.height = height;
    }
    // A finger scrolls the page until there is something to pan.
    const touch = view.zoom > 1 ? "none" : "pan-y";
    if (canvas.style.touchAction !== touch) canvas.style.touchAction = touch;
    const context = canvas.getContext("2d");
    context.clearRect(0, 0, width, height);
    context.imageSmoothingEnabled = false; // a pixel is a measurement: never blend two
    const w = source.width / view.zoom, h = source.height / view.zoom;
    for (const layer of view.cover ? [source, view.cover] : [source]) {
      context.drawImage(layer, view.left * source.width, view.top * source.height, w, h,
        0, 0, width, height);
    }
    if (view.pick) this.mark(context, width / w, height / h);
  }

  mark(context, scaleX, scaleY) {
    const { source, view } = this;
    const x = (view.pick.x - view.left * source.width) * scaleX;
    const y = (view.pick.y - view.top * source.height) * scaleY;
    const edge = Math.max(scaleX, 9), out = (edge - scaleX) / 2;
    for (const [colour, grow] of [["#000", 2.5], ["#fff", 1]]) {
      context.strokeStyle = colour;
      context.lineWidth = 1.5;
      context.strokeRect(x - out - grow, y - out - grow, edge + 2 * grow, edge + 2 * grow);
    }
  }

  /** Image pixel under a pointer. */
  pixelAt(event) {
    const box = this.canvas.getBoundingClientRect(), { view, source } = this;
    const x = view.left + (event.clientX - box.left) / box.width / view.zoom;
    const y = view.top + (event.clientY - box.top) / box.height / view.zoom;
    const inside = (value, size) => Math.min(size - 1, Math.max(0, Math.floor(value * size)));
    return { x: inside(x, source.width), y: inside(y, source.height) };
  }
}

/** The part of the images that all panels show: zoom and upper left corner, 0 to 1. */
class View {
  constructor() { this.reset(); this.pick = null; this.cover = null; }

  reset() { this.zoom = 1; this.left = 0; this.top = 0; }

  /** Zoom by a factor so that the point (x, y) of the panel, 0 to 1, stays where it is. */
  zoomBy(factor, x, y) {
    const zoom = Math.min(64, Math.max(1, this.zoom * factor));
    this.left += x / this.zoom - x / zoom;
    this.top += y / this.zoom - y / zoom;
    this.zoom = zoom;
    this.keepInside();
  }

  /** Move the content by parts of the panel's width and height. */
  moveBy(x, y) {
    this.left -= x / this.zoom;
    this.top -= y / this.zoom;
    this.keepInside();
  }

  keepInside() {
    const most = 1 - 1 / this.zoom;
    this.left = Math.min(most, Math.max(0, this.left));
    this.top = Math.min(most, Math.max(0, this.top));
  }
}

/** Drag, pinch and wheel on every panel; a tap picks a pixel. */
function linkPointers(panel, view, redraw, pick) {
  const down = new Map();
  let moved = 0;
  const canvas = panel.canvas;
  const part = (event) => {
    const box = canvas.getBoundingClientRect();
    return { x: (event.clientX - box.left) / box.width, y: (event.clientY - box.top) / box.height };
  };
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    down.set(event.pointerId, part(event));
    if (down.size === 1) moved = 0;
  });
  canvas.addEventListener("pointermove", (event) => {
    const before = down.get(event.pointerId), now = part(event);
    if (!before) {
      if (event.pointerType === "mouse" && !view.locked) pick(panel.pixelAt(event));
      return;
    }
    const others = [...down].filter(([id]) => id !== event.pointerId);
    if (others.length) {
      const other = others[0][1];
      const distance = (a) => Math.hypot(a.x - other.x, a.y - other.y) || 1e-6;
      // About the fingers' middle as it was; the move below follows where it went.
      view.zoomBy(distance(now) / distance(before), (before.x + other.x) / 2,
        (before.y + other.y) / 2);
    }
    const share = others.length ? 0.5 : 1;
    view.moveBy((now.x - before.x) * share, (now.y - before.y) * share);
    moved += Math.hypot(now.x - before.x, now.y - before.y);
    down.set(event.pointerId, now);
    redraw();
  });
  const up = (event) => {
    if (down.delete(event.pointerId) && event.type === "pointerup" && moved < 0.02) {
      view.locked = true;
      pick(panel.pixelAt(event));
    }
  };
  canvas.addEventListener("pointerup", up);
  canvas.addEventListener("pointercancel", up);
  canvas.addEventListener("wheel", (event) => {
    // The page keeps its scrolling until the reader has turned to the viewer.
    if (!event.ctrlKey && !canvas.closest("#viewer").contains(document.activeElement)) return;
    event.preventDefault();
    const { x, y } = part(event);
    view.zoomBy(Math.exp(-event.deltaY / 300), x, y);
    redraw();
  }, { passive: false });
}
