// Images from three numbers a pixel. Equation numbers are the paper's.

const LEVELS = 1024;            // entries of a colour table
const NOT_FINITE = 65535;       // stored for a value that is not finite
const BAD = packed(255, 0, 255); // and how it is painted

function packed(red, green, blue) {
  return ((255 << 24) | (blue << 16) | (green << 8) | red) >>> 0; // little endian RGBA
}

function bytesOf(block) {
  const text = atob(document.getElementById("block-" + block).textContent.trim());
  const bytes = new Uint8Array(text.length);
  for (let i = 0; i < text.length; i++) bytes[i] = text.charCodeAt(i);
  return bytes;
}

/** Positions in the image of the pixels of a mask, row by row. */
function positionsOf(mask, pixels, size) {
  const bits = bytesOf(mask);
  const at = new Uint32Array(pixels);
  let found = 0;
  for (let i = 0; i < size; i++) {
    if (bits[i >> 3] & (128 >> (i & 7))) at[found++] = i;
  }
  return at;
}

/** Numbers of the object's pixels that see more than one normal. */
function mixedOf(scene) {
  const mixed = new Set();
  if (scene.mixed === null) return mixed;
  const bits = bytesOf(scene.mixed);
  for (let i = 0; i < scene.pixels; i++) {
    if (bits[i >> 3] & (128 >> (i & 7))) mixed.add(i);
  }
  return mixed;
}

/** Stokes planes [s0, s1, s2]; what is not stored is the truth's s0, or zero. */
function stokesOf(planes, pixels, truth) {
  const stored = new Uint16Array(bytesOf(planes.block).buffer);
  return [0, 1, 2].map((component) => {
    const plane = planes.components.indexOf(component);
    if (plane < 0) return component ? new Float32Array(pixels) : truth[0];
    const step = planes.step[plane], first = planes.first[plane], values = new Float32Array(pixels);
    for (let i = 0; i < pixels; i++) {
      const q = stored[plane * pixels + i];
      values[i] = q === NOT_FINITE ? NaN : step * (first + q);
    }
    return values;
  });
}

/** Stokes planes of light that is a weighted sum of others: of bands, or of colours. */
function weighed(all, weights) {
  return [0, 1, 2].map((component) => {
    const sum = new Float32Array(all[0][component].length);
    all.forEach((stokes, k) => {
      const plane = stokes[component], weight = weights[k];
      if (weight) for (let i = 0; i < sum.length; i++) sum[i] += weight * plane[i];
    });
    return sum;
  });
}

function differenceOf(estimate, truth) {
  return estimate.map((plane, k) => plane.map((value, i) => value - truth[k][i]));
}

/** Equation 1: the radiance behind a polariser at an angle in degrees from the vertical. */
function radiance(s0, s1, s2, degrees) {
  const double = degrees * Math.PI / 90;
  return 0.5 * (s0 - s1 * Math.cos(double) - s2 * Math.sin(double));
}

/** Equation 1 for every pixel, as colours: table[round(I(angle) * scale + middle)]. */
function paintRadiance(out, at, stokes, degrees, scale, middle, table) {
  const [s0, s1, s2] = stokes, top = table.length - 1;
  const half = 0.5 * scale, double = degrees * Math.PI / 90;
  const cosine = half * Math.cos(double), sine = half * Math.sin(double);
  const start = middle + 0.5; // rounds to the nearest entry
  for (let i = 0; i < at.length; i++) {
    const v = half * s0[i] - cosine * s1[i] - sine * s2[i] + start;
    out[at[i]] = v !== v ? BAD : table[v < 0 ? 0 : v > top ? top : v | 0];
  }
}

/** The same in colour: of red, green and blue each, through the curve of the screen. */
function paintColour(out, at, channels, degrees, scale, curve) {
  const top = curve.length - 1, double = degrees * Math.PI / 90;
  const half = 0.5 * scale, cosine = half * Math.cos(double), sine = half * Math.sin(double);
  const [red, green, blue] = channels.map(([s0, s1, s2]) => {
    const codes = new Int16Array(at.length);
    for (let i = 0; i < at.length; i++) {
      const v = half * s0[i] - cosine * s1[i] - sine * s2[i] + 0.5;
      codes[i] = v !== v ? -1 : curve[v < 0 ? 0 : v > top ? top : v | 0];
    }
    return codes;
  });
  for (let i = 0; i < at.length; i++) {
    const r = red[i], g = green[i], b = blue[i];
    out[at[i]] = (r | g | b) < 0 ? BAD : packed(r, g, b);
  }
}

/** Degree of linear polarisation: of no light 0, of less than none no number. */
function dolpOf(s0, s1, s2) { return s0 > 0 ? Math.hypot(s1, s2) / s0 : s0 === 0 ? 0 : NaN; }

/** The place of the largest finite value. */
function largestOf(values) {
  let best = 0;
  values.forEach((value, i) => { if (value > values[best] || !Number.isFinite(values[best])) best = i; });
  return best;
}

/** Angle of linear polarisation in degrees, 0 to 180, anticlockwise from the horizontal. */
function aolpOf(s1, s2) { return (Math.atan2(s2, s1) * 90 / Math.PI + 180) % 180; }

function paintDolp(out, at, stokes, largest, table) {
  const [s0, s1, s2] = stokes, top = table.length - 1;
  for (let i = 0; i < at.length; i++) {
    const v = dolpOf(s0[i], s1[i], s2[i]) / largest * top + 0.5;
    out[at[i]] = v !== v ? BAD : table[v > top ? top : v | 0];
  }
}

/** Grey where so little is polarised that the angle says nothing. */
function paintAolp(out, at, stokes, least, grey, table) {
  const [s0, s1, s2] = stokes;
  for (let i = 0; i < at.length; i++) {
    const dolp = dolpOf(s0[i], s1[i], s2[i]);
    const place = aolpOf(s1[i], s2[i]) / 180 * table.length | 0;
    out[at[i]] = dolp !== dolp ? BAD : dolp < least ? grey : table[place % table.length];
  }
}

/** A colour table of `LEVELS` entries from 256 stored RGB colours; cyclic ones join at the end. */
function tableOf(base64, cyclic) {
  const text = atob(base64), colours = text.length / 3, table = new Uint32Array(LEVELS);
  const channel = (colour, k) => text.charCodeAt(3 * (colour % colours) + k);
  for (let i = 0; i < LEVELS; i++) {
    const place = cyclic ? i / LEVELS * colours : i / (LEVELS - 1) * (colours - 1);
    const left = Math.floor(place), part = place - left;
    const right = cyclic ? left + 1 : Math.min(left + 1, colours - 1);
    const mixed = [0, 1, 2].map((k) =>
      Math.round(channel(left, k) * (1 - part) + channel(right, k) * part));
    table[i] = packed(...mixed);
  }
  return table;
}

/** Linear radiance to the code of a screen (the sRGB curve). */
function screenCurve() {
  return Uint8Array.from({ length: LEVELS }, (_, i) => {
    const x = i / (LEVELS - 1);
    return Math.round(255 * (x <= 0.0031308 ? 12.92 * x : 1.055 * x ** (1 / 2.4) - 0.055));
  });
}

/** The value below which a part of the finite values lies. */
function quantile(values, part) {
  const sorted = values.filter(Number.isFinite).sort();
  return sorted.length ? sorted[Math.min(sorted.length - 1, Math.floor(part * sorted.length))] : 0;
}

/** Half of (s0 + polarised part) of every pixel: the most that any polariser lets through. */
function brightest(stokes) {
  return stokes[0].map((s0, i) => 0.5 * (Math.abs(s0) + Math.hypot(stokes[1][i], stokes[2][i])));
}
