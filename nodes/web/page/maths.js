// Quaternions (xyzw), vectors and 4x4 matrices (column-major), as plain functions on arrays.

/** @typedef {ArrayLike<number>} Numbers */

/**
 * Product of two quaternions, written into `out` at `at`.
 * @param {number[] | Float32Array} out @param {number} at
 * @param {Numbers} a @param {number} i @param {Numbers} b @param {number} j
 */
export function quatMultiply(out, at, a, i, b, j) {
  const ax = a[i], ay = a[i + 1], az = a[i + 2], aw = a[i + 3];
  const bx = b[j], by = b[j + 1], bz = b[j + 2], bw = b[j + 3];
  out[at] = aw * bx + ax * bw + ay * bz - az * by;
  out[at + 1] = aw * by - ax * bz + ay * bw + az * bx;
  out[at + 2] = aw * bz + ax * by - ay * bx + az * bw;
  out[at + 3] = aw * bw - ax * bx - ay * by - az * bz;
}

/**
 * A vector turned by a quaternion, plus an offset, written into `out` at `at`.
 * @param {number[] | Float32Array} out @param {number} at
 * @param {Numbers} q @param {number} i @param {Numbers} v @param {number} j
 * @param {Numbers} plus @param {number} k
 */
export function quatRotateAdd(out, at, q, i, v, j, plus, k) {
  const x = q[i], y = q[i + 1], z = q[i + 2], w = q[i + 3];
  const vx = v[j], vy = v[j + 1], vz = v[j + 2];
  const ux = 2 * (y * vz - z * vy), uy = 2 * (z * vx - x * vz), uz = 2 * (x * vy - y * vx);
  out[at] = vx + w * ux + y * uz - z * uy + plus[k];
  out[at + 1] = vy + w * uy + z * ux - x * uz + plus[k + 1];
  out[at + 2] = vz + w * uz + x * uy - y * ux + plus[k + 2];
}

/**
 * Normalised linear interpolation of a quaternion along the shorter way.
 * @param {Float32Array} out @param {number} at
 * @param {Numbers} a @param {Numbers} b @param {number} i @param {number} s share of b, 0..1
 */
export function quatMix(out, at, a, b, i, s) {
  const dot = a[i] * b[i] + a[i + 1] * b[i + 1] + a[i + 2] * b[i + 2] + a[i + 3] * b[i + 3];
  const t = dot < 0 ? -s : s, r = 1 - s;
  const x = r * a[i] + t * b[i], y = r * a[i + 1] + t * b[i + 1];
  const z = r * a[i + 2] + t * b[i + 2], w = r * a[i + 3] + t * b[i + 3];
  const n = 1 / (Math.hypot(x, y, z, w) || 1);
  out[at] = x * n; out[at + 1] = y * n; out[at + 2] = z * n; out[at + 3] = w * n;
}

/**
 * World rotations and positions of all joints.
 * @param {Numbers} parents @param {Numbers} offsets (J, 3) @param {Numbers} root (3) @param {Numbers} local (J, 4)
 * @param {Float32Array} rotations (J, 4) out @param {Float32Array} positions (J, 3) out
 */
export function forwardKinematics(parents, offsets, root, local, rotations, positions) {
  for (let j = 0; j < parents.length; j++) {
    const p = parents[j];
    if (p < 0) {
      for (let k = 0; k < 4; k++) rotations[k] = local[k];
      for (let k = 0; k < 3; k++) positions[k] = root[k];
    } else {
      quatMultiply(rotations, 4 * j, rotations, 4 * p, local, 4 * j);
      quatRotateAdd(positions, 3 * j, rotations, 4 * p, offsets, 3 * j, positions, 3 * p);
    }
  }
}

/** @param {Numbers} a @param {Numbers} b @returns {Float32Array} a * b */
export function matMultiply(a, b) {
  const out = new Float32Array(16);
  for (let c = 0; c < 4; c++) {
    for (let r = 0; r < 4; r++) {
      out[4 * c + r] =
        a[r] * b[4 * c] + a[4 + r] * b[4 * c + 1] + a[8 + r] * b[4 * c + 2] + a[12 + r] * b[4 * c + 3];
    }
  }
  return out;
}

/** @param {number} yfov @param {number} aspect @param {number} near @param {number} far */
export function perspective(yfov, aspect, near, far) {
  const t = 1 / Math.tan(yfov / 2), d = 1 / (near - far);
  return new Float32Array([t / aspect, 0, 0, 0, 0, t, 0, 0, 0, 0, (far + near) * d, -1, 0, 0, 2 * far * near * d, 0]);
}

/** @param {number} height @param {number} aspect @param {number} near @param {number} far */
export function orthographic(height, aspect, near, far) {
  const d = 1 / (near - far);
  return new Float32Array([
    2 / (height * aspect), 0, 0, 0, 0, 2 / height, 0, 0, 0, 0, 2 * d, 0, 0, 0, (far + near) * d, 1,
  ]);
}

/**
 * The axes of a turned frame: x, y and z as nine numbers.
 * @param {Numbers} q
 */
export function axesOf(q) {
  const x = q[0], y = q[1], z = q[2], w = q[3];
  return [
    1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y),
    2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x),
    2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y),
  ];
}

/**
 * World to camera.
 * @param {Numbers} position @param {Numbers} axes nine numbers, as `axesOf`
 */
export function viewMatrix(position, axes) {
  /** @param {number} i */
  const along = (i) => -(axes[i] * position[0] + axes[i + 1] * position[1] + axes[i + 2] * position[2]);
  return new Float32Array([
    axes[0], axes[3], axes[6], 0, axes[1], axes[4], axes[7], 0, axes[2], axes[5], axes[8], 0,
    along(0), along(3), along(6), 1,
  ]);
}

/** @param {number} value @param {number} low @param {number} high */
export const clamp = (value, low, high) => Math.min(high, Math.max(low, value));
