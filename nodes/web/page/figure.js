// The figure: a mesh of rigid parts, each turned by its joint on the graphics processor.

import {attributes, drawElements, link, texture} from "./gl.js";
import {forwardKinematics, quatRotateAdd} from "./maths.js";

const VERTEX = `
layout(location=0) in ivec4 place; layout(location=1) in vec3 normal; layout(location=2) in vec3 color;
uniform mat4 matrix; uniform float scale; uniform highp sampler2D joints;
out vec3 at, facing, tint;
vec3 turn(vec4 q, vec3 v) { return v + 2.0 * cross(q.xyz, cross(q.xyz, v) + q.w * v); }
void main() {
  vec4 q = texelFetch(joints, ivec2(0, place.w), 0);
  at = turn(q, vec3(place.xyz) * scale) + texelFetch(joints, ivec2(1, place.w), 0).xyz;
  facing = turn(q, normal);
  tint = color * color; // sRGB to light, nearly
  gl_Position = matrix * vec4(at, 1.0);
}`;

// The offline renderer's light: hemisphere, wrapped key, a little fill, a soft highlight, a rim, darker near the floor.
const FRAGMENT = `
precision highp float;
in vec3 at, facing, tint; uniform vec3 eye, key; out vec4 color;
void main() {
  vec3 n = normalize(facing), v = normalize(eye - at);
  float up = n.y * 0.5 + 0.5, lit = max(dot(n, key) * 0.78 + 0.22, 0.0);
  lit *= lit * 0.45 + 0.55;
  vec3 sky = mix(vec3(0.27, 0.245, 0.235), vec3(0.42, 0.46, 0.54), up);
  vec3 fill = vec3(0.10, 0.11, 0.13) * max(dot(n, normalize(vec3(-key.z, 0.25, key.x))), 0.0);
  float contact = clamp(at.y * 2.2 + 0.48, 0.0, 1.0), high = max(dot(n, normalize(key + v)), 0.0);
  float gloss = pow(high, 48.0) * 0.17 + pow(high, 10.0) * 0.05, edge = 1.0 - max(dot(n, v), 0.0);
  vec3 c = tint * (sky * contact + fill + vec3(1.22, 1.13, 1.00) * lit)
    + gloss * lit + vec3(0.20, 0.23, 0.28) * edge * edge * edge * up;
  c = c * (1.0 + 0.06 * c) / (1.0 + 0.20 * c);
  color = vec4(sqrt(c), 1.0);
}`;

/** Direction to the key light. */
export const KEY = [-0.4201, 0.7701, 0.4801];

/**
 * @typedef {{figure: string, hash: string, names: string[], parents: number[], offsets: number[],
 *   roles: Record<string, number>, mesh: string}} Skeleton
 */

/** One figure on the stage: skeleton, pose in world coordinates, and its vertex array. */
export class Figure {
  /**
   * @param {import("./gl.js").GL} gl @param {Skeleton} skeleton @param {import("./wire.js").Mesh} mesh
   */
  constructor(gl, skeleton, mesh) {
    const count = skeleton.parents.length;
    this.skeleton = skeleton;
    this.mesh = mesh;
    this.rotations = new Float32Array(4 * count);
    this.positions = new Float32Array(3 * count);
    this.texels = new Float32Array(8 * count);
    /** World ends of the capsules: (C, 8) as start (3), radius, end (3), radius. */
    this.capsules = new Float32Array(8 * mesh.capsules.length);
    /** Those that cast a shadow worth drawing: not small balls and finger tips. @type {number[]} */
    this.casting = mesh.capsules.flatMap((row, i) => {
      const ball = row[1] === row[5] && row[2] === row[6] && row[3] === row[7];
      return row[4] > (ball ? 0.05 : 0.018) ? [i] : [];
    });
    this.upload(gl);
    const rest = new Float32Array(4 * count);
    for (let j = 0; j < count; j++) rest[4 * j + 3] = 1;
    this.pose(skeleton.offsets.slice(0, 3), rest);
  }

  /** Makes the figure's things on the graphics processor (again, after it was lost). @param {import("./gl.js").GL} gl */
  upload(gl) {
    const mesh = this.mesh;
    this.array = gl.createVertexArray();
    gl.bindVertexArray(this.array);
    const short = {slot: 0, size: 4, type: gl.SHORT, integer: true};
    attributes(gl, mesh.positions, [short], 8);
    attributes(gl, mesh.normals, [{slot: 1, size: 3, type: gl.BYTE, normalized: true}], 4);
    attributes(gl, mesh.colors, [{slot: 2, size: 3, type: gl.UNSIGNED_BYTE, normalized: true}], 4);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, mesh.indices, gl.STATIC_DRAW);
    gl.bindVertexArray(null);
    this.indexType = mesh.indices instanceof Uint32Array ? gl.UNSIGNED_INT : gl.UNSIGNED_SHORT;
    this.joints = texture(gl, gl.RGBA32F, 2, this.skeleton.parents.length, gl.NEAREST);
  }

  /**
   * Take a pose. @param {ArrayLike<number>} root (3) @param {ArrayLike<number>} local (J, 4)
   */
  pose(root, local) {
    const {parents, offsets} = this.skeleton;
    if (local.length !== 4 * parents.length) return;
    forwardKinematics(parents, offsets, root, local, this.rotations, this.positions);
    for (let j = 0; j < parents.length; j++) {
      for (let k = 0; k < 4; k++) this.texels[8 * j + k] = this.rotations[4 * j + k];
      for (let k = 0; k < 3; k++) this.texels[8 * j + 4 + k] = this.positions[3 * j + k];
    }
    this.mesh.capsules.forEach((row, i) => {
      const j = row[0];
      quatRotateAdd(this.capsules, 8 * i, this.rotations, 4 * j, row, 1, this.positions, 3 * j);
      quatRotateAdd(this.capsules, 8 * i + 4, this.rotations, 4 * j, row, 5, this.positions, 3 * j);
      this.capsules[8 * i + 3] = row[4];
      this.capsules[8 * i + 7] = row[8];
    });
  }

  /** World position of the joint that plays a role. @param {string} role @returns {number[] | null} */
  place(role) {
    const j = this.skeleton.roles[role];
    return j === undefined ? null : [...this.positions.subarray(3 * j, 3 * j + 3)];
  }
}

/** Draws figures. */
export class FigurePainter {
  /** @param {import("./gl.js").GL} gl */
  constructor(gl) {
    this.gl = gl;
    this.program = link(gl, VERTEX, FRAGMENT);
  }

  /** @param {Figure} figure @param {import("./view.js").View} view */
  draw(figure, view) {
    const gl = this.gl, {program, at} = this.program;
    gl.useProgram(program);
    gl.bindVertexArray(figure.array ?? null);
    gl.bindTexture(gl.TEXTURE_2D, figure.joints ?? null);
    gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, 2, figure.texels.length / 8, gl.RGBA, gl.FLOAT, figure.texels);
    gl.uniformMatrix4fv(at.matrix, false, view.matrix);
    gl.uniform1f(at.scale, figure.mesh.scale);
    gl.uniform3fv(at.eye, view.eye);
    gl.uniform3fv(at.key, KEY);
    gl.enable(gl.CULL_FACE);
    drawElements(gl, figure.mesh.indices.length, figure.indexType ?? gl.UNSIGNED_SHORT);
    gl.disable(gl.CULL_FACE);
  }
}
