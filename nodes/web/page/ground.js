// The ground with its grid, and the figure's soft shadow: capsules laid along the light into a small texture.

import {attributes, drawArrays, link, texture} from "./gl.js";
import {KEY} from "./figure.js";

const TEXELS = 128;
const MARGIN = 1.6; // m around the figures that the shadow's texture covers
export const MOST_CAPSULES = 40;

const SHADOW_VERTEX = `
const vec2 corner[3] = vec2[3](vec2(-1.0, -1.0), vec2(3.0, -1.0), vec2(-1.0, 3.0));
out vec2 at;
void main() { at = corner[gl_VertexID]; gl_Position = vec4(at, 0.0, 1.0); }`;

// What each cone keeps out of the light at a place on the ground: its edge is the softer the higher it is; and
// straight below, what is near the ground keeps the sky's light out.
const SHADOW_FRAGMENT = `
precision highp float;
in vec2 at; uniform int count; uniform float half_size; uniform vec2 slope;
uniform vec4 starts[${MOST_CAPSULES}], ends[${MOST_CAPSULES}]; out vec4 color;
float cover(vec2 p, vec2 a, vec2 b, vec2 radii, vec2 softs, float strength) {
  vec2 d = b - a;
  float t = clamp(dot(p - a, d) / (dot(d, d) + 1e-9), 0.0, 1.0);
  float radius = mix(radii.x, radii.y, t), soft = mix(softs.x, softs.y, t);
  float c = clamp((radius - distance(p, a + t * d)) / (2.0 * soft) + 0.5, 0.0, 1.0);
  return c * c * (3.0 - 2.0 * c) * min(radius / soft, 1.0) * strength;
}
void main() {
  vec2 p = at * half_size;
  float light = 1.0;
  for (int i = 0; i < count; i++) {
    vec4 a = starts[i], b = ends[i];
    vec2 high = max(vec2(a.y, b.y), 0.0), radii = vec2(a.w, b.w);
    light *= 1.0 - cover(p, a.xz - slope * high.x, b.xz - slope * high.y, radii, 0.014 + 0.075 * high, 0.9);
    float gap = min(high.x - radii.x, high.y - radii.y);
    if (gap < 0.1) light *= 1.0 - cover(p, a.xz, b.xz, radii * 1.25, vec2(0.03), 0.55 * (1.0 - max(gap, 0.0) / 0.1));
  }
  color = vec4(1.0 - light);
}`;

const GROUND_VERTEX = `
layout(location=0) in vec2 corner; uniform mat4 matrix; uniform vec2 center; out vec2 at;
void main() { at = corner + center; gl_Position = matrix * vec4(at.x, 0.0, at.y, 1.0); }`;

const GROUND_FRAGMENT = `
precision highp float;
in vec2 at; uniform vec2 center, middle; uniform vec3 back, ground, glow; uniform float size, ink;
uniform sampler2D shadow; out vec4 color;
float lines(vec2 place, vec2 width) {
  vec2 near = abs(fract(place - 0.5) - 0.5) / width;
  return 1.0 - min(min(near.x, near.y), 1.0);
}
void main() {
  float far = length(at - center), fade = clamp(1.0 - (far - 1.8) * 0.13, 0.0, 1.0);
  fade *= fade * (3.0 - 2.0 * fade);
  vec2 width = fwidth(at) * 1.25;
  float fine = 1.0 - smoothstep(0.02, 0.11, max(width.x, width.y));
  float grid = lines(at, width) * 0.15 + lines(at * 4.0, width * 4.0) * 0.05 * fine;
  vec3 sun = mix(back, ground, fade) + glow * exp(-0.22 * far * far);
  float dark = texture(shadow, (at - middle) / size + 0.5).r * 0.60;
  vec3 tint = mix(vec3(1.0), vec3(0.80, 0.84, 0.93), dark);
  color = vec4(sun * (1.0 - ink * grid * fade) * (1.0 - dark) * tint, 1.0);
}`;

/** @typedef {{back: number[], ground: number[], glow: number[], ink: number}} Look `ink`: 1 dark lines, below 0 light ones */
/** @type {Record<"light" | "dark", Look>} */
export const LOOKS = {
  light: {back: [0.855, 0.88, 0.908], ground: [0.9, 0.905, 0.912], glow: [0.022, 0.02, 0.016], ink: 1},
  dark: {back: [0.098, 0.11, 0.129], ground: [0.176, 0.19, 0.212], glow: [0.05, 0.05, 0.048], ink: -1.6},
};

export class Ground {
  /** @param {import("./gl.js").GL} gl */
  constructor(gl) {
    this.gl = gl;
    this.shadowProgram = link(gl, SHADOW_VERTEX, SHADOW_FRAGMENT);
    this.program = link(gl, GROUND_VERTEX, GROUND_FRAGMENT);
    this.empty = gl.createVertexArray();
    this.array = gl.createVertexArray();
    gl.bindVertexArray(this.array);
    const corners = new Float32Array([-10, -10, -10, 10, 10, -10, 10, 10]);
    attributes(gl, corners, [{slot: 0, size: 2, type: gl.FLOAT}], 8);
    gl.bindVertexArray(null);
    this.texture = texture(gl, gl.R8, TEXELS, TEXELS, gl.LINEAR);
    this.frame = gl.createFramebuffer();
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.frame);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, this.texture, 0);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    this.starts = new Float32Array(4 * MOST_CAPSULES);
    this.ends = new Float32Array(4 * MOST_CAPSULES);
    this.center = [0, 0];
    this.middle = [0, 0];
    this.size = 3.6;
  }

  /**
   * Lay the shadow of figures; call before the picture is begun.
   * @param {import("./figure.js").Figure[]} figures
   */
  cast(figures) {
    const gl = this.gl, slope = [KEY[0] / KEY[1], KEY[2] / KEY[1]];
    if (figures.length) this.cover(figures, slope);
    const share = Math.floor(MOST_CAPSULES / Math.max(1, figures.length));
    let count = 0;
    for (const {capsules, casting} of figures) {
      for (const i of casting.slice(0, share)) {
        for (let k = 0; k < 4; k++) {
          const shift = k === 0 ? this.middle[0] : k === 2 ? this.middle[1] : 0;
          this.starts[4 * count + k] = capsules[8 * i + k] - shift;
          this.ends[4 * count + k] = capsules[8 * i + 4 + k] - shift;
        }
        count++;
      }
    }
    const {program, at} = this.shadowProgram;
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.frame);
    gl.viewport(0, 0, TEXELS, TEXELS);
    gl.disable(gl.DEPTH_TEST);
    gl.useProgram(program);
    gl.bindVertexArray(this.empty);
    gl.uniform1i(at.count, count);
    gl.uniform1f(at.half_size, this.size / 2);
    gl.uniform2fv(at.slope, slope);
    gl.uniform4fv(at.starts, this.starts);
    gl.uniform4fv(at.ends, this.ends);
    drawArrays(gl, gl.TRIANGLES, 3);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
  }

  /**
   * The square that holds the figures' shadows, steady as they move; and the middle around which the ground is lit.
   * @param {import("./figure.js").Figure[]} figures @param {number[]} slope
   */
  cover(figures, slope) {
    const low = [Infinity, Infinity], high = [-Infinity, -Infinity];
    for (const {positions} of figures) {
      for (let i = 0; i < positions.length; i += 3) {
        for (const k of [0, 1]) {
          low[k] = Math.min(low[k], positions[i + 2 * k]);
          high[k] = Math.max(high[k], positions[i + 2 * k]);
        }
      }
    }
    const spread = Math.max(high[0] - low[0], high[1] - low[1]) + 1.2;
    this.size = Math.max(3.6, 2 * MARGIN * Math.ceil(spread / (2 * MARGIN)) + 0.4);
    const cell = this.size / TEXELS;
    this.middle = [0, 1].map((k) => Math.round(((low[k] + high[k]) / 2 - slope[k] * 0.45) / cell) * cell);
    this.center = [figures[0].positions[0], figures[0].positions[2]];
  }

  /** @param {import("./view.js").View} view @param {Look} look */
  draw(view, look) {
    const gl = this.gl, {program, at} = this.program;
    gl.useProgram(program);
    gl.bindVertexArray(this.array);
    gl.bindTexture(gl.TEXTURE_2D, this.texture);
    gl.uniformMatrix4fv(at.matrix, false, view.matrix);
    gl.uniform2fv(at.center, this.center);
    gl.uniform2fv(at.middle, this.middle);
    gl.uniform1f(at.size, this.size);
    gl.uniform3fv(at.back, look.back);
    gl.uniform3fv(at.ground, look.ground);
    gl.uniform3fv(at.glow, look.glow);
    gl.uniform1f(at.ink, look.ink);
    drawArrays(gl, gl.TRIANGLE_STRIP, 4);
  }
}
