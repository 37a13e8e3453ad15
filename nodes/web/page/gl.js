// A thin layer over WebGL2: programs with their uniforms, vertex arrays, and a count of what is drawn.

/** @typedef {WebGL2RenderingContext} GL */
/** @typedef {{program: WebGLProgram, at: Record<string, WebGLUniformLocation>}} Program */

/** Draw calls since the last `reset`. */
export const drawn = {calls: 0, reset() { const n = this.calls; this.calls = 0; return n; }};

/**
 * @param {GL} gl @param {string} vertex @param {string} fragment
 * @returns {Program}
 */
export function link(gl, vertex, fragment) {
  const program = gl.createProgram();
  /** @type {[number, string][]} */
  const stages = [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]];
  for (const [type, text] of stages) {
    const shader = /** @type {WebGLShader} */ (gl.createShader(type));
    gl.shaderSource(shader, `#version 300 es\n${text}`);
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS) && !gl.isContextLost()) {
      throw new Error(gl.getShaderInfoLog(shader) ?? "a shader does not compile");
    }
    gl.attachShader(program, shader);
  }
  gl.linkProgram(program);
  /** @type {Record<string, WebGLUniformLocation>} */
  const at = {};
  const count = gl.getProgramParameter(program, gl.ACTIVE_UNIFORMS) ?? 0;
  for (let i = 0; i < count; i++) {
    const info = gl.getActiveUniform(program, i);
    const name = info?.name.replace("[0]", "") ?? "";
    const place = gl.getUniformLocation(program, name);
    if (place) at[name] = place;
  }
  return {program, at};
}

/**
 * A buffer with its attributes, bound to the vertex array that is current.
 * @param {GL} gl @param {AllowSharedBufferSource} data
 * @param {{slot: number, size: number, type: number, normalized?: boolean, integer?: boolean, offset?: number}[]} layout
 * @param {number} stride bytes
 * @param {number} [usage]
 * @returns {WebGLBuffer}
 */
export function attributes(gl, data, layout, stride, usage = gl.STATIC_DRAW) {
  const buffer = gl.createBuffer();
  gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
  gl.bufferData(gl.ARRAY_BUFFER, data, usage);
  for (const {slot, size, type, normalized = false, integer = false, offset = 0} of layout) {
    gl.enableVertexAttribArray(slot);
    if (integer) gl.vertexAttribIPointer(slot, size, type, stride, offset);
    else gl.vertexAttribPointer(slot, size, type, normalized, stride, offset);
  }
  return buffer;
}

/**
 * @param {GL} gl @param {number} format @param {number} width @param {number} height @param {number} filter
 * @returns {WebGLTexture}
 */
export function texture(gl, format, width, height, filter) {
  const made = gl.createTexture();
  gl.bindTexture(gl.TEXTURE_2D, made);
  gl.texStorage2D(gl.TEXTURE_2D, 1, format, width, height);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, filter);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, filter);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE);
  return made;
}

/** @param {GL} gl @param {number} mode @param {number} count */
export function drawArrays(gl, mode, count) {
  drawn.calls++;
  gl.drawArrays(mode, 0, count);
}

/** @param {GL} gl @param {number} count @param {number} type */
export function drawElements(gl, count, type) {
  drawn.calls++;
  gl.drawElements(gl.TRIANGLES, count, type, 0);
}
