// Overlays as triangles: circles, lines, polygons, points, stick figures, bars and words.
// Everything is laid into three lists: what lies on the ground, what stands in the world (drawn over the figure) and
// what is on the picture. So there are three draw calls, however much there is.

import {project} from "./view.js";

/** @typedef {import("./wire.js").Primitive} Primitive */
/** @typedef {import("./view.js").View} View */
/** @typedef {{x: number, y: number, width: number, height: number}} Box in shares of the picture */

/** Numbers a vertex has: x, y, z, u, v and a colour in four bytes. */
export const WORDS = 6;
const SEGMENTS = 40;
const GROUND = 0.03; // m, height below which a thing lies on the ground, under the figure
const LABEL = 0.026; // of the picture's height
const RING = 0.0045; // of the picture's height, thickness of a circle's rim
const FILL = 0.24; // share of its colour's opacity with which a circle is filled
const BAR = 0.03; // m, or share of the panel's height
const THIN = 0.08; // of the smallest letters: a bit more than a pixel
const CARD = [1, 1, 1, 0.62], DARK_CARD = [0.12, 0.15, 0.18, 0.72];
/** The first panel's place in shares of the picture; others follow to its right. @type {Box} */
export const PANEL = {x: 0.015, y: 0.68, width: 0.3, height: 0.3};

/** A growing list of triangles. */
export class Sheet {
  constructor() {
    this.data = new Float32Array(WORDS * 3072);
    this.bytes = new Uint8Array(this.data.buffer);
    this.count = 0;
    this.ink = [255, 255, 255, 255];
  }

  clear() {
    this.count = 0;
  }

  /** @param {ArrayLike<number>} color 0..1 */
  color(color) {
    this.ink = [0, 1, 2, 3].map((k) => Math.round(255 * (color[k] ?? 1)));
  }

  /** @param {number} x @param {number} y @param {number} z @param {number} [u] @param {number} [v] */
  vertex(x, y, z, u = -1, v = -1) {
    if (WORDS * (this.count + 1) > this.data.length) {
      const larger = new Float32Array(2 * this.data.length);
      larger.set(this.data);
      this.data = larger;
      this.bytes = new Uint8Array(larger.buffer);
    }
    const at = WORDS * this.count++;
    this.data[at] = x; this.data[at + 1] = y; this.data[at + 2] = z;
    this.data[at + 3] = u; this.data[at + 4] = v;
    this.bytes.set(this.ink, 4 * at + 20);
  }

  /** @param {number[]} a @param {number[]} b @param {number[]} c */
  triangle(a, b, c) {
    for (const p of [a, b, c]) this.vertex(p[0], p[1], p[2]);
  }

  /** @param {number[]} a @param {number[]} b @param {number[]} c @param {number[]} d */
  quad(a, b, c, d) {
    this.triangle(a, b, c);
    this.triangle(a, c, d);
  }
}

/**
 * Points of a primitive as triples; shares of the picture become (x * aspect, y, 0), so that a length is the same
 * both ways, and a panel's shares are laid into its box.
 * @param {Primitive} primitive @param {number} aspect @param {Box} panel
 * @returns {number[][]}
 */
export function placed(primitive, aspect, panel) {
  const out = [], {points, dim, space} = primitive;
  for (let i = 0; i + dim <= points.length; i += dim) {
    if (space === "world") out.push([points[i], points[i + 1], points[i + 2]]);
    else if (space === "panel") {
      out.push([(panel.x + points[i] * panel.width) * aspect, panel.y + points[i + 1] * panel.height, 0]);
    } else out.push([points[i] * aspect, points[i + 1], 0]);
  }
  return out;
}

/**
 * What lies across a line at a place: unit length, square to the viewer (world) or on the picture.
 * @param {number[]} at @param {number[]} d the line's direction @param {View | null} view
 */
function across(at, d, view) {
  let side = [-d[1], d[0], 0];
  if (view) {
    const look = view.ortho ? view.axes.slice(6) : at.map((v, k) => view.eye[k] - v);
    side = [d[1] * look[2] - d[2] * look[1], d[2] * look[0] - d[0] * look[2], d[0] * look[1] - d[1] * look[0]];
  }
  const n = Math.hypot(...side);
  return side.map((v) => v / (n || 1));
}

/**
 * A path of a width, in one piece: neighbours share their corner, so that nothing lies twice over.
 * @param {Sheet} sheet @param {number[][]} points @param {number} width @param {View | null} view
 * @param {{closed?: boolean, least?: number}} [how] `least`: the smallest width that is seen, a share of the picture's
 *   height
 */
export function ribbon(sheet, points, width, view, {closed = false, least = 0} = {}) {
  const path = points.filter((p, i) => !i || p.some((v, k) => Math.abs(v - points[i - 1][k]) > 1e-7));
  if (closed && path.length > 2) path.push(path[0]);
  if (path.length < 2) return;
  const ways = path.slice(1).map((p, i) => p.map((v, k) => v - path[i][k]));
  const edges = path.map((p, i) => {
    const before = ways[i - 1] ?? (closed ? ways[ways.length - 1] : ways[0]);
    const after = ways[i] ?? (closed ? ways[0] : before);
    const one = across(p, before, view), other = across(p, after, view);
    const sum = one.map((v, k) => v + other[k]), n = Math.hypot(...sum);
    const cos = n / 2; // of half the turn
    const mitre = cos > 0.3 ? sum.map((v) => v / n / Math.min(1, Math.max(0.5, cos))) : other;
    const wide = Math.max(width, least * (view ? heightAt(view, p) : 1)) / 2;
    return [p.map((v, k) => v + wide * mitre[k]), p.map((v, k) => v - wide * mitre[k])];
  });
  for (let i = 1; i < edges.length; i++) sheet.quad(edges[i - 1][0], edges[i][0], edges[i][1], edges[i - 1][1]);
}

/** Triangles of the polygons that are shown, kept from frame to frame. @type {WeakMap<Primitive, number[][]>} */
const known = new WeakMap();

/** @param {Primitive} primitive @param {number[][]} points */
function filled(primitive, points) {
  const triangles = known.get(primitive) ?? ears(points);
  known.set(primitive, triangles);
  return triangles;
}

/**
 * A polygon's triangles as corners' numbers, by cutting off ears; it may be hollowed but not cross itself.
 * @param {number[][]} points @returns {number[][]}
 */
export function ears(points) {
  // seen along the axis to which it is turned most
  const normal = [0, 0, 0];
  points.forEach((p, i) => {
    const q = points[(i + 1) % points.length];
    for (let k = 0; k < 3; k++) normal[k] += (p[(k + 1) % 3] - q[(k + 1) % 3]) * (p[(k + 2) % 3] + q[(k + 2) % 3]);
  });
  const axis = [0, 1, 2].reduce((best, k) => (Math.abs(normal[k]) > Math.abs(normal[best]) ? k : best), 0);
  const turn = Math.sign(normal[axis]) || 1, [u, v] = [(axis + 1) % 3, (axis + 2) % 3];
  /** @param {number} a @param {number} b @param {number} c twice the area, above zero to the left */
  const area = (a, b, c) => {
    const [p, q, r] = [points[a], points[b], points[c]];
    return turn * ((q[u] - p[u]) * (r[v] - p[v]) - (q[v] - p[v]) * (r[u] - p[u]));
  };
  const left = points.map((_, i) => i), last = points.length - 1;
  if (left.every((i) => i < 1 || i >= last || (area(i - 1, i, i + 1) >= 0 && area(0, i, i + 1) >= 0))) {
    return left.slice(2).map((i) => [0, i - 1, i]); // nothing hollow: a fan
  }
  const out = [];
  while (left.length > 3) {
    const found = left.findIndex((b, i) => {
      const a = left[(i + left.length - 1) % left.length], c = left[(i + 1) % left.length];
      return area(a, b, c) > 0 && left.every((p) =>
        p === a || p === b || p === c || area(a, b, p) < 0 || area(b, c, p) < 0 || area(c, a, p) < 0);
    });
    const i = Math.max(0, found), n = left.length; // one that crosses itself loses some corner
    out.push([left[(i + n - 1) % n], left[i], left[(i + 1) % n]]);
    left.splice(i, 1);
  }
  if (left.length === 3) out.push(left);
  return out;
}

/**
 * @param {Sheet} sheet @param {number[]} center @param {number} radius @param {number[]} u @param {number[]} v axes of the plane
 * @param {number} inner share of the radius that is left out
 */
export function disc(sheet, center, radius, u, v, inner) {
  /** @param {number} i @param {number} r */
  const at = (i, r) => {
    const c = r * Math.cos((2 * Math.PI * i) / SEGMENTS), s = r * Math.sin((2 * Math.PI * i) / SEGMENTS);
    return center.map((p, k) => p + c * u[k] + s * v[k]);
  };
  for (let i = 0; i < SEGMENTS; i++) {
    if (inner > 0) sheet.quad(at(i, radius), at(i + 1, radius), at(i + 1, radius * inner), at(i, radius * inner));
    else sheet.triangle(center, at(i, radius), at(i + 1, radius));
  }
}

/**
 * @typedef {{least: number, line(text: string): {width: number, glyphs: {x: number, w: number, u: number[]}[]}}} Letters
 * A word's glyphs at height 1: where each begins, how wide it is, and its place in the atlas (u0, v0, u1, v1);
 * `least`: the smallest readable height, a share of the picture's.
 */

/**
 * @param {Sheet} sheet @param {Letters} letters @param {string} text @param {number[]} at left end of the base line
 * @param {number} height @param {number} [align] share of the width that lies left of `at`
 */
export function words(sheet, letters, text, at, height, align = 0) {
  const {width, glyphs} = letters.line(text);
  const left = at[0] - align * width * height;
  for (const {x, w, u} of glyphs) {
    const x0 = left + x * height, x1 = x0 + w * height, y0 = at[1] - 0.8 * height, y1 = at[1] + 0.2 * height;
    sheet.vertex(x0, y0, 0, u[0], u[1]); sheet.vertex(x1, y0, 0, u[2], u[1]); sheet.vertex(x1, y1, 0, u[2], u[3]);
    sheet.vertex(x0, y0, 0, u[0], u[1]); sheet.vertex(x1, y1, 0, u[2], u[3]); sheet.vertex(x0, y1, 0, u[0], u[3]);
  }
}

/**
 * Lay all that nodes want to be drawn; each node's panel gets a card of its own.
 * @param {Sheets} sheets @param {Iterable<{primitives: Primitive[]}>} layers @param {View} view @param {number} aspect
 * @param {Letters} letters @param {number[]} parents @param {boolean} dark @param {Box} [panel]
 */
export function layAll(sheets, layers, view, aspect, letters, parents, dark, panel = PANEL) {
  let panels = 0;
  for (const {primitives} of layers) {
    const box = {...panel, x: panel.x + panels * (panel.width + 0.01)};
    if (primitives.some((one) => one.space === "panel")) {
      panels++;
      const [x0, x1] = [box.x * aspect, (box.x + box.width) * aspect], [y0, y1] = [box.y, box.y + box.height];
      sheets.picture.color(dark ? DARK_CARD : CARD);
      sheets.picture.quad([x0, y0, 0], [x1, y0, 0], [x1, y1, 0], [x0, y1, 0]);
    }
    for (const one of primitives) lay(sheets, one, view, aspect, box, letters, parents);
  }
}

/** @typedef {{ground: Sheet, world: Sheet, picture: Sheet}} Sheets */

/**
 * Lay one primitive.
 * @param {Sheets} sheets @param {Primitive} primitive @param {View} view
 * @param {number} aspect @param {Box} panel @param {Letters} letters
 * @param {number[]} parents of the figure, for stick figures
 */
export function lay(sheets, primitive, view, aspect, panel, letters, parents) {
  const world = primitive.space === "world";
  const points = placed(primitive, aspect, panel);
  const low = world && points.every((p) => p[1] < GROUND);
  const sheet = low ? sheets.ground : world ? sheets.world : sheets.picture;
  const scale = primitive.space === "panel" ? panel.height : 1;
  const size = primitive.size * scale, color = primitive.color;
  const facing = world ? view : null, thin = THIN * letters.least;
  const right = world ? view.axes.slice(0, 3) : [1, 0, 0], up = world ? view.axes.slice(3, 6) : [0, 1, 0];
  /** @param {number} share */
  const faint = (share) => [...color.slice(0, 3), Math.min(1, color[3] * share)];
  sheet.color(color);
  switch (primitive.kind) {
    case "circle":
      for (const p of points) {
        const rim = world ? Math.max(0.006, RING * heightAt(view, p)) : RING;
        const [u, v] = world ? [[1, 0, 0], [0, 0, 1]] : [right, up];
        sheet.color(color);
        disc(sheet, p, size, u, v, Math.max(0, 1 - rim / (size || 1)));
        sheet.color(faint(FILL));
        if (size > rim) disc(sheet, p, size - rim, u, v, 0);
      }
      break;
    case "points":
      for (const p of points) disc(sheet, p, size / 2, right, up, 0);
      break;
    case "line":
      ribbon(sheet, points, size, facing, {least: thin});
      break;
    case "polygon":
      for (const [i, j, k] of filled(primitive, points)) sheet.triangle(points[i], points[j], points[k]);
      sheet.color(faint(1.6));
      if (world) ribbon(sheet, points, size, facing, {closed: true, least: thin});
      break;
    case "figure":
      points.forEach((p, j) => {
        const parent = parents[j] ?? -1;
        if (parent >= 0 && parent < points.length) ribbon(sheet, [points[parent], p], size, facing, {least: thin});
        disc(sheet, p, 0.75 * size, right, up, 0);
      });
      break;
    case "bar":
      if (points.length >= 2) layBar(sheet, points[0], points[1], primitive, BAR * scale, facing);
      break;
    case "text":
      break;
  }
  if (primitive.label && points.length) layLabel(sheets.picture, primitive, points, view, aspect, scale, letters);
}

/**
 * A bar from one point to another, filled by its value.
 * @param {Sheet} sheet @param {number[]} a @param {number[]} b @param {Primitive} primitive @param {number} width
 * @param {View | null} facing
 */
function layBar(sheet, a, b, primitive, width, facing) {
  const share = Math.min(1, Math.max(0, primitive.size));
  sheet.color([...primitive.color.slice(0, 3), primitive.color[3] * 0.25]);
  ribbon(sheet, [a, b], width, facing);
  sheet.color(primitive.color);
  ribbon(sheet, [a, a.map((v, k) => v + share * (b[k] - v))], width, facing);
}

/** Metres that the picture's height spans at a place. @param {View} view @param {number[]} p */
function heightAt(view, p) {
  return view.scale * (view.ortho ? 1 : Math.max(0, project(view, p).depth));
}

/**
 * @param {Sheet} sheet of the picture @param {Primitive} primitive @param {number[][]} points @param {View} view
 * @param {number} aspect @param {number} scale @param {Letters} letters
 */
function layLabel(sheet, primitive, points, view, aspect, scale, letters) {
  const text = primitive.kind === "text";
  sheet.color(primitive.color);
  let [x, y] = points[0], height = text ? primitive.size * scale : LABEL;
  if (primitive.space === "world") {
    const seen = project(view, points[0]);
    if (seen.depth <= 0) return;
    if (text) height = primitive.size / heightAt(view, points[0]);
    [x, y] = [seen.x * aspect + 0.006, seen.y - 0.006];
  } else if (primitive.kind === "circle") {
    const lift = primitive.size * scale + RING;
    [x, y] = [x + lift, y - lift];
  }
  words(sheet, letters, primitive.label, [x, y], Math.max(height, letters.least));
}
