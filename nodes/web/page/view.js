// The picture on the page: its rectangle, letterboxed to the camera's aspect, and its projection.

import {axesOf, matMultiply, orthographic, perspective, viewMatrix} from "./maths.js";

/** @typedef {{left: number, top: number, width: number, height: number}} Rect */
/**
 * @typedef {{matrix: Float32Array, eye: number[], axes: number[], ortho: boolean, scale: number}} View
 * `scale`: metres that the picture's height spans, at 1 m of depth where not orthographic.
 */

const NEAR = 0.05, FAR = 80;

/** @type {import("./wire.js").Camera} */
export const DEFAULT_CAMERA = {
  stamp: 0,
  position: [2.4, 1.45, 3.9],
  rotation: lookAt([2.4, 1.45, 3.9], [0, 0.9, 0]),
  yfov: 0.576,
  orthoHeight: 0,
  aspect: 16 / 9,
};

/**
 * The largest rectangle of an aspect, centred.
 * @param {number} aspect @param {number} width @param {number} height
 * @returns {Rect}
 */
export function letterbox(aspect, width, height) {
  if (width > aspect * height) {
    return {left: (width - aspect * height) / 2, top: 0, width: aspect * height, height};
  }
  return {left: 0, top: (height - width / aspect) / 2, width, height: width / aspect};
}

/**
 * The rotation of a level camera that looks from `eye` to `center`.
 * @param {number[]} eye @param {number[]} center
 */
export function lookAt(eye, center) {
  const back = eye.map((v, k) => v - center[k]);
  const yaw = Math.atan2(back[0], back[2]), pitch = -Math.atan2(back[1], Math.hypot(back[0], back[2]));
  const sy = Math.sin(yaw / 2), cy = Math.cos(yaw / 2), sp = Math.sin(pitch / 2), cp = Math.cos(pitch / 2);
  return [cy * sp, sy * cp, -sy * sp, cy * cp];
}

/** @param {import("./wire.js").Camera} camera @returns {View} */
export function viewOf(camera) {
  const axes = axesOf(camera.rotation), ortho = camera.orthoHeight > 0;
  const lens = ortho
    ? orthographic(camera.orthoHeight, camera.aspect, NEAR, FAR) : perspective(camera.yfov, camera.aspect, NEAR, FAR);
  return {
    matrix: matMultiply(lens, viewMatrix(camera.position, axes)),
    eye: camera.position,
    axes,
    ortho,
    scale: ortho ? camera.orthoHeight : 2 * Math.tan(camera.yfov / 2),
  };
}

/**
 * Where a place on the page lies on the picture: shares from its top-left.
 * @param {Rect} picture in the page's pixels @param {number} x @param {number} y
 */
export function shareOf(picture, x, y) {
  return {x: (x - picture.left) / picture.width, y: (y - picture.top) / picture.height};
}

/**
 * Shares of the picture where a world point appears, and its depth (m before the camera).
 * @param {View} view @param {ArrayLike<number>} p
 */
export function project(view, p) {
  const m = view.matrix;
  const w = m[3] * p[0] + m[7] * p[1] + m[11] * p[2] + m[15];
  const x = (m[0] * p[0] + m[4] * p[1] + m[8] * p[2] + m[12]) / w;
  const y = (m[1] * p[0] + m[5] * p[1] + m[9] * p[2] + m[13]) / w;
  return {x: 0.5 + 0.5 * x, y: 0.5 - 0.5 * y, depth: w};
}
