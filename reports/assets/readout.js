// What is known of one pixel: numbers and its sinusoid, truth and estimate.

const SIGNIFICANT = 4;

function number(value, digits = SIGNIFICANT) {
  return Number.isFinite(value) ? String(Number(value.toPrecision(digits))) : "not finite";
}

function fixed(value, digits, unit) {
  return Number.isFinite(value) ? value.toFixed(digits) + unit : "not finite";
}

// The place beside the axis takes eight characters.
function short(value) {
  const small = value !== 0 && Math.abs(value) < 1e-3;
  return small ? value.toExponential(value < 0 ? 1 : 2) : number(value, 3);
}

function rowOf([s0, s1, s2], degrees) {
  const polarised = Math.hypot(s1, s2);
  const aolp = aolpOf(s1, s2);
  return [
    number(radiance(s0, s1, s2, degrees)),
    number(0.5 * (s0 + polarised)),
    number(0.5 * (s0 - polarised)),
    fixed((aolp + 90) % 180, 1, "°"),       // ψ counts from the vertical
    fixed(100 * dolpOf(s0, s1, s2), 2, " %"),
    fixed(aolp, 1, "°"),
  ];
}

class Readout {
  constructor(root) {
    this.place = root.querySelector(".place");
    this.cells = [...root.querySelectorAll("tbody tr")].map((row) => [...row.querySelectorAll("td")]);
    this.plot = root.querySelector("svg");
    this.paths = ["truth", "estimate"].map((name) => this.plot.querySelector("." + name));
    this.dots = ["truth", "estimate"].map((name) => this.plot.querySelector(".dot-" + name));
    this.line = this.plot.querySelector(".now");
    this.most = this.plot.querySelector(".most");
    this.least = this.plot.querySelector(".least");
  }

  nothing(text) {
    this.place.textContent = text;
    this.cells.flat().forEach((cell) => { cell.textContent = "–"; });
    this.paths.forEach((path) => path.removeAttribute("d"));
    this.dots.forEach((dot) => dot.setAttribute("visibility", "hidden"));
  }

  show(pixel, step, truth, estimate, degrees, note) {
    const [column, row] = [pixel.x * step, pixel.y * step];
    this.place.textContent = `Pixel column ${column}, row ${row} from the upper left${note}`;
    const both = [truth, estimate];
    const columns = both.map((stokes) => rowOf(stokes, degrees));
    this.cells.forEach((cells, row) => cells.forEach((cell, k) => {
      cell.textContent = columns[k][row];
    }));
    this.range(both);
    both.forEach((stokes, k) => this.curve(stokes, k, degrees));
    this.turn(degrees);
  }

  /** The axis spans both sinusoids and says where it starts: it seldom starts at zero. */
  range(both) {
    const ends = both.flatMap(([s0, s1, s2]) => {
      const polarised = Math.hypot(s1, s2);
      return [0.5 * (s0 - polarised), 0.5 * (s0 + polarised)];
    }).filter(Number.isFinite);
    const low = Math.min(...ends), high = Math.max(...ends);
    const margin = Math.max(0.08 * (high - low), 0.002 * Math.abs(high)) || 1;
    this.low = low - margin;
    this.high = high + margin;
    this.least.textContent = short(this.low);
    this.most.textContent = short(this.high);
  }

  height(value) { return 110 - 100 * (value - this.low) / (this.high - this.low); }

  curve([s0, s1, s2], k, degrees) {
    const at = (angle) => this.height(radiance(s0, s1, s2, angle));
    const finite = Number.isFinite(s0 + s1 + s2), points = [];
    for (let angle = 0; finite && angle <= 180; angle += 3) {
      points.push((50 + 1.35 * angle).toFixed(1) + "," + at(angle).toFixed(2));
    }
    this.paths[k].setAttribute("d", finite ? "M" + points.join("L") : "");
    this.dots[k].setAttribute("visibility", finite ? "visible" : "hidden");
    this.dots[k].setAttribute("cx", 50 + 1.35 * degrees);
    if (finite) this.dots[k].setAttribute("cy", at(degrees));
  }

  turn(degrees) {
    this.line.setAttribute("x1", 50 + 1.35 * degrees);
    this.line.setAttribute("x2", 50 + 1.35 * degrees);
  }
}
