// Draws the overlays' sheets, and keeps the letters that they need in one texture.

import {attributes, drawArrays, link} from "./gl.js";
import {layAll, Sheet, WORDS} from "./overlays.js";

const VERTEX = `
layout(location=0) in vec3 at; layout(location=1) in vec2 place; layout(location=2) in vec4 color;
uniform mat4 matrix; out vec2 uv; out vec4 tint;
void main() { uv = place; tint = color; gl_Position = matrix * vec4(at, 1.0); }`;

const FRAGMENT = `
precision highp float;
in vec2 uv; in vec4 tint; uniform sampler2D letters; uniform float night; out vec4 color;
void main() {
  if (uv.x < 0.0) { color = vec4(tint.rgb, 1.0) * tint.a; return; }
  vec2 cover = texture(letters, uv).rg; // of the letter, and of its halo
  vec3 ink = night > 0.5 ? mix(tint.rgb, vec3(1.0), 0.65) : tint.rgb * 0.55;
  color = vec4(ink, 1.0) * cover.r * min(1.0, 0.25 + tint.a)
    + vec4(vec3(1.0 - night), 1.0) * (1.0 - cover.r) * cover.g * 0.55 * tint.a;
}`;

const ATLAS = 512, CELL = 40, FONT = 30, EDGE = 4; // pixels

/** Glyphs drawn once each by the browser's own text engine. */
export class Alphabet {
  /** @param {import("./gl.js").GL} gl */
  constructor(gl) {
    this.gl = gl;
    this.canvas = document.createElement("canvas");
    this.canvas.width = this.canvas.height = ATLAS;
    this.pen = /** @type {CanvasRenderingContext2D} */ (this.canvas.getContext("2d", {willReadFrequently: true}));
    this.pen.font = `600 ${FONT}px system-ui, sans-serif`;
    this.wipe();
    /** @type {Map<string, {x: number, y: number, w: number}>} */
    this.glyphs = new Map();
    this.next = {x: 0, y: 0};
    this.changed = true;
    this.least = 0;
    this.texture = gl.createTexture();
  }

  /** On black, red then holds how much of a pixel a letter covers, and green its halo. */
  wipe() {
    this.pen.fillStyle = "#000";
    this.pen.globalCompositeOperation = "source-over";
    this.pen.fillRect(0, 0, ATLAS, ATLAS);
    this.pen.globalCompositeOperation = "lighter";
    this.pen.fillStyle = "#f00";
    this.pen.strokeStyle = "#0f0";
    this.pen.lineWidth = 6;
    this.pen.lineJoin = "round";
  }

  /** @param {string} letter */
  glyph(letter) {
    let found = this.glyphs.get(letter);
    if (found) return found;
    const w = Math.min(ATLAS, Math.ceil(this.pen.measureText(letter).width) + 2 * EDGE);
    if (this.next.x + w > ATLAS) this.next = {x: 0, y: this.next.y + CELL};
    if (this.next.y + CELL > ATLAS) { // full: begin again
      this.glyphs.clear();
      this.wipe();
      this.next = {x: 0, y: 0};
    }
    this.pen.save();
    this.pen.beginPath();
    this.pen.rect(this.next.x, this.next.y, w, CELL);
    this.pen.clip();
    this.pen.strokeText(letter, this.next.x + EDGE, this.next.y + 0.8 * CELL);
    this.pen.fillText(letter, this.next.x + EDGE, this.next.y + 0.8 * CELL);
    this.pen.restore();
    found = {x: this.next.x, y: this.next.y, w};
    this.glyphs.set(letter, found);
    this.next.x += w;
    this.changed = true;
    return found;
  }

  /** @param {string} text */
  line(text) {
    let x = 0;
    const glyphs = [...text].map((letter) => {
      const {x: left, y: top, w} = this.glyph(letter);
      const one = {x: x - EDGE / CELL, w: w / CELL, u: [left / ATLAS, top / ATLAS, (left + w) / ATLAS, (top + CELL) / ATLAS]};
      x += (w - 2 * EDGE) / CELL;
      return one;
    });
    return {width: x, glyphs};
  }

  bind() {
    const gl = this.gl;
    gl.bindTexture(gl.TEXTURE_2D, this.texture);
    if (!this.changed) return;
    this.changed = false;
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RG8, gl.RG, gl.UNSIGNED_BYTE, this.canvas);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.LINEAR_MIPMAP_LINEAR);
    gl.generateMipmap(gl.TEXTURE_2D);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE);
  }
}

export class Ink {
  /** @param {import("./gl.js").GL} gl */
  constructor(gl) {
    this.gl = gl;
    this.program = link(gl, VERTEX, FRAGMENT);
    this.letters = new Alphabet(gl);
    this.sheets = {ground: new Sheet(), world: new Sheet(), picture: new Sheet()};
    this.array = gl.createVertexArray();
    gl.bindVertexArray(this.array);
    this.capacity = this.sheets.world.data.byteLength;
    this.buffer = attributes(gl, new Uint8Array(this.capacity), [
      {slot: 0, size: 3, type: gl.FLOAT},
      {slot: 1, size: 2, type: gl.FLOAT, offset: 12},
      {slot: 2, size: 4, type: gl.UNSIGNED_BYTE, normalized: true, offset: 20},
    ], 4 * WORDS, gl.DYNAMIC_DRAW);
    gl.bindVertexArray(null);
  }

  /**
   * @param {Iterable<{primitives: import("./wire.js").Primitive[]}>} layers @param {import("./view.js").View} view
   * @param {number} aspect @param {boolean} dark @param {number[]} parents
   */
  draw(layers, view, aspect, dark, parents) {
    const gl = this.gl, {ground, world, picture} = this.sheets;
    ground.clear();
    world.clear();
    picture.clear();
    layAll(this.sheets, layers, view, aspect, this.letters, parents, dark);
    if (!ground.count && !world.count && !picture.count) return;
    const {program, at} = this.program;
    gl.useProgram(program);
    gl.bindVertexArray(this.array);
    this.letters.bind();
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    gl.depthMask(false);
    gl.uniform1f(at.night, dark ? 1 : 0);
    gl.uniformMatrix4fv(at.matrix, false, view.matrix);
    if (ground.count) this.pour(ground);
    gl.disable(gl.DEPTH_TEST);
    if (world.count) this.pour(world);
    if (picture.count) {
      gl.uniformMatrix4fv(at.matrix, false, [2 / aspect, 0, 0, 0, 0, -2, 0, 0, 0, 0, 1, 0, -1, 1, 0, 1]);
      this.pour(picture);
    }
    gl.depthMask(true);
    gl.disable(gl.BLEND);
  }

  /** @param {Sheet} sheet */
  pour(sheet) {
    const gl = this.gl, used = sheet.data.subarray(0, WORDS * sheet.count);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.buffer);
    if (used.byteLength > this.capacity) this.capacity = sheet.data.byteLength;
    gl.bufferData(gl.ARRAY_BUFFER, this.capacity, gl.DYNAMIC_DRAW);
    gl.bufferSubData(gl.ARRAY_BUFFER, 0, used);
    drawArrays(gl, gl.TRIANGLES, sheet.count);
  }
}

