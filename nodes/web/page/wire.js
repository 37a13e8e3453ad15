// Reads the binary bundles of the page server; the layout is described in nodes/web/protocol.py.

export const POSE = 1, CAMERA = 2, OVERLAY = 3;

/**
 * @typedef {{stamp: number, echo: number, seq: number, feet: number, root: Float32Array, rotations: Float32Array}} Pose
 * `stamp` ms of the stage's clock, `echo` this page's own time (ms) of the input it stems from or NaN.
 * @typedef {{stamp: number, position: number[], rotation: number[], yfov: number, orthoHeight: number,
 *   aspect: number}} Camera
 * @typedef {{kind: string, space: string, color: number[], size: number, label: string, dim: number,
 *   points: Float32Array}} Primitive
 * @typedef {{topic: string, primitives: Primitive[]}} Overlay
 * @typedef {{kind: number, figure: number, view: DataView}} Part
 */

/**
 * @param {ArrayBuffer} buffer
 * @returns {{number: number, parts: Part[]}}
 */
export function readBundle(buffer) {
  const all = new DataView(buffer);
  /** @type {Part[]} */
  const parts = [];
  let at = 4;
  while (at + 8 <= buffer.byteLength) {
    const length = all.getUint32(at + 4, true);
    if (at + 8 + length > buffer.byteLength) throw new RangeError("a part is longer than its bundle");
    parts.push({kind: all.getUint8(at), figure: all.getUint8(at + 1), view: new DataView(buffer, at + 8, length)});
    at += 8 + length + ((4 - (length % 4)) % 4);
  }
  return {number: all.getUint32(0, true), parts};
}

/** @param {number} number @returns {ArrayBuffer} */
export function acknowledge(number) {
  const data = new DataView(new ArrayBuffer(4));
  data.setUint32(0, number, true);
  return data.buffer;
}

/** @param {DataView} view @returns {Pose} */
export function readPose(view) {
  const joints = view.getUint16(20, true);
  const rotations = new Float32Array(4 * joints);
  for (let i = 0; i < 4 * joints; i++) rotations[i] = view.getInt16(36 + 2 * i, true) / 32767;
  return {
    stamp: view.getFloat64(0, true),
    echo: view.getFloat64(8, true),
    seq: view.getUint32(16, true),
    feet: view.getUint16(22, true),
    root: new Float32Array([view.getFloat32(24, true), view.getFloat32(28, true), view.getFloat32(32, true)]),
    rotations,
  };
}

/** @param {DataView} view @returns {Camera} */
export function readCamera(view) {
  const f = Array.from({length: 10}, (_, i) => view.getFloat32(8 + 4 * i, true));
  return {
    stamp: view.getFloat64(0, true),
    position: f.slice(0, 3),
    rotation: f.slice(3, 7),
    yfov: f[7],
    orthoHeight: f[8],
    aspect: f[9],
  };
}

/** @param {DataView} view @returns {Overlay} */
export function readOverlay(view) {
  const length = view.getUint32(0, true);
  const head = JSON.parse(new TextDecoder().decode(new Uint8Array(view.buffer, view.byteOffset + 4, length)));
  let at = view.byteOffset + 4 + length + ((4 - (length % 4)) % 4);
  for (const primitive of head.primitives) {
    primitive.points = new Float32Array(view.buffer, at, primitive.count * primitive.dim);
    at += 4 * primitive.count * primitive.dim;
  }
  return head;
}

/**
 * @typedef {{vertices: number, positions: Int16Array, scale: number, normals: Int8Array, colors: Uint8Array,
 *   indices: Uint16Array | Uint32Array, capsules: number[][]}} Mesh
 * Positions (V, 4): int16 * scale m in the frame of the joint that is the fourth; normals (V, 4) of 1/127; capsules:
 * rows of joint, start (3), radius, end (3), radius, m in the joint's frame.
 */

/**
 * Reads the mesh that nodes/web/mesh.py packs.
 * @param {ArrayBuffer} buffer
 * @returns {Mesh}
 */
export function readMesh(buffer) {
  const view = new DataView(buffer), bytes = new Uint8Array(buffer);
  if (view.getUint32(0, true) !== 0x314d4b42) throw new TypeError("this is no mesh");
  const [vertices, triangles, colorCount, coneCount] = [4, 8, 12, 16].map((at) => view.getUint32(at, true));
  const scale = view.getFloat32(20, true);
  const capsules = Array.from({length: coneCount}, (_, i) =>
    Array.from({length: 9}, (_, k) => view.getFloat32(24 + 4 * (9 * i + k), true)));
  const palette = 24 + 36 * coneCount;
  let at = palette + 3 * colorCount;
  /**
   * The next column: numbers that were told by their differences.
   * @param {number} count @param {number} planes @param {(i: number, value: number) => void} put
   */
  const column = (count, planes, put) => {
    for (let i = 0, value = 0; i < count; i++) {
      let zigzag = 0;
      for (let k = 0; k < planes; k++) zigzag += bytes[at + k * count + i] * 256 ** k;
      value += zigzag % 2 ? -(zigzag + 1) / 2 : zigzag / 2;
      put(i, value);
    }
    at += planes * count;
  };
  const positions = new Int16Array(4 * vertices), normals = new Int8Array(4 * vertices);
  const colors = new Uint8Array(4 * vertices);
  for (let k = 0; k < 3; k++) column(vertices, 2, (i, value) => { positions[4 * i + k] = value; });
  for (let k = 0; k < 3; k++) column(vertices, 2, (i, value) => { normals[4 * i + k] = value; });
  column(vertices, 2, (i, value) => colors.set(bytes.subarray(palette + 3 * value, palette + 3 * value + 3), 4 * i));
  column(vertices, 2, (i, value) => { positions[4 * i + 3] = value; });
  const indices = vertices > 65535 ? new Uint32Array(3 * triangles) : new Uint16Array(3 * triangles);
  for (let k = 0; k < 3; k++) column(triangles, 3, (i, value) => { indices[3 * i + k] = value; });
  return {vertices, scale, positions, normals, colors, indices, capsules};
}
