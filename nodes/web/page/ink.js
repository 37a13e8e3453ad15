// Draws the overlays' sheets, and keeps the letters that they need in one texture.

import {attributes, drawArrays, link} from "./gl.js";
import {lay, Sheet, WORDS} from "./overlays.js";

const VERTEX = `
layout(location=0) in vec3 at; layout(location=1) in vec2 place; layout(location=2) in vec4 color;
uniform mat4 matrix; out vec2 uv; out vec4 tint;
void main() { uv = place; tint = color; gl_Position = matrix * vec4(at, 1.0); }`;

const FRAGMENT = `
precision highp float;
in vec2 uv; in vec4 tint; uniform sampler2D letters; out vec4 color;
void main() {
  float cover = uv.x < 0.0 ? 1.0 : texture(letters, uv).r;
  color = vec4(tint.rgb, 1.0) * (tint.a * cover);
}`;

const ATLAS = 512, CELL = 40, FONT = 30; // pixels

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
    this.texture = gl.createTexture();
  }

  /** White on black: the red channel then holds how much of a pixel a letter covers. */
  wipe() {
    this.pen.fillStyle = "#000";
    this.pen.fillRect(0, 0, ATLAS, ATLAS);
    this.pen.fillStyle = "#fff";
  }

  /** @param {string} letter */
  glyph(letter) {
    let found = this.glyphs.get(letter);
    if (found) return found;
    const w = Math.min(ATLAS, Math.ceil(this.pen.measureText(letter).width) + 2);
    if (this.next.x + w > ATLAS) this.next = {x: 0, y: this.next.y + CELL};
    if (this.next.y + CELL > ATLAS) { // full: begin again
      this.glyphs.clear();
      this.wipe();
      this.next = {x: 0, y: 0};
    }
    this.pen.fillText(letter, this.next.x + 1, this.next.y + 0.8 * CELL);
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
      const one = {x, w: w / CELL, u: [left / ATLAS, top / ATLAS, (left + w) / ATLAS, (top + CELL) / ATLAS]};
      x += (w - 2) / CELL;
      return one;
    });
    return {width: x, glyphs};
  }

  bind() {
    const gl = this.gl;
    gl.bindTexture(gl.TEXTURE_2D, this.texture);
    if (!this.changed) return;
    this.changed = false;
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.R8, gl.RED, gl.UNSIGNED_BYTE, this.canvas);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.LINEAR);
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
    this.sheets = {world: new Sheet(), picture: new Sheet()};
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
   * @param {Iterable<import("./wire.js").Primitive>} primitives @param {import("./view.js").View} view
   * @param {number} aspect @param {import("./overlays.js").Box} panel @param {number[]} parents
   */
  draw(primitives, view, aspect, panel, parents) {
    const gl = this.gl, {world, picture} = this.sheets;
    world.clear();
    picture.clear();
    for (const one of primitives) lay(this.sheets, one, view, aspect, panel, this.letters, parents);
    if (!world.count && !picture.count) return;
    const {program, at} = this.program;
    gl.useProgram(program);
    gl.bindVertexArray(this.array);
    this.letters.bind();
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    gl.depthMask(false);
    if (world.count) {
      gl.uniformMatrix4fv(at.matrix, false, view.matrix);
      this.pour(world);
    }
    if (picture.count) {
      gl.disable(gl.DEPTH_TEST);
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

