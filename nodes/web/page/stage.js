// What is drawn: figures as they arrive, the camera, overlays, and a take's ghost when it is looked at.

import {Figure, FigurePainter} from "./figure.js";
import {drawn} from "./gl.js";
import {Ground, LOOKS} from "./ground.js";
import {Ink} from "./ink.js";
import {Pace} from "./pace.js";
import {mixCameras, mixPoses, Playout, Track} from "./playout.js";
import {DEFAULT_CAMERA, letterbox, viewOf} from "./view.js";
import {CAMERA, OVERLAY, POSE, readCamera, readMesh, readOverlay, readPose} from "./wire.js";

const LEAST_LETTERS = 15; // pixels of the page

/** @typedef {{time: number, root: Float32Array, rotations: Float32Array}} TakeFrame */

/** All that arrives for the picture, and the picture of it. */
export class Stage {
  /** @param {HTMLCanvasElement} canvas */
  constructor(canvas) {
    this.canvas = canvas;
    const smooth = new URLSearchParams(location.search).get("aa") !== "0";
    const gl = canvas.getContext("webgl2", {antialias: smooth, alpha: false, powerPreference: "high-performance"});
    if (!gl) throw new Error("The figure is drawn by WebGL 2, which this browser lacks or has switched off. Try another browser.");
    this.gl = gl;
    /** @type {Map<number, Figure>} */
    this.figures = new Map();
    /** @type {Map<number, Track<import("./wire.js").Pose>>} */
    this.poses = new Map();
    /** @type {Track<import("./wire.js").Camera>} */
    this.cameras = new Track();
    /** @type {Map<string, import("./wire.js").Overlay>} */
    this.overlays = new Map();
    this.playout = new Playout();
    this.camera = DEFAULT_CAMERA;
    /** The newest pose that was drawn, and when. */
    this.shown = {seq: -1, echo: NaN, stamp: 0};
    /** @type {TakeFrame | null} */
    this.replay = null;
    this.look = LOOKS.light;
    this.pace = new Pace();
    this.figure = 0;
    /** @type {(() => void)[]} */
    this.wishes = [];
    /** Where the canvas lies on the page: kept, for asking after something was written costs a layout. */
    this.box = canvas.getBoundingClientRect();
    const measure = () => this.measure();
    new ResizeObserver(measure).observe(canvas);
    addEventListener("resize", measure);
    addEventListener("pointerdown", measure, true);
    canvas.addEventListener("webglcontextlost", (event) => event.preventDefault());
    canvas.addEventListener("webglcontextrestored", () => this.build());
    this.build();
  }

  /** Look where the canvas lies now: after something beside it came or went. */
  measure() {
    this.box = this.canvas.getBoundingClientRect();
  }

  /** Makes everything that lives on the graphics processor. */
  build() {
    this.painter = new FigurePainter(this.gl);
    this.ground = new Ground(this.gl);
    this.ink = new Ink(this.gl);
    for (const figure of this.figures.values()) figure.upload(this.gl);
  }

  /** @param {import("./figure.js").Skeleton & {index: number}} skeleton */
  async dress(skeleton) {
    if (this.figures.get(skeleton.index)?.skeleton.hash === skeleton.hash) return;
    const answer = await fetch(skeleton.mesh);
    if (!answer.ok) throw new Error("the figure's mesh did not come");
    this.figures.set(skeleton.index, new Figure(this.gl, skeleton, readMesh(await answer.arrayBuffer())));
  }

  /** Another run of the stage, or the same again, begins to tell what it shows. @param {number} figures how many */
  renew(figures) {
    this.playout.reset();
    this.overlays.clear();
    for (const index of this.figures.keys()) if (index >= figures) this.figures.delete(index);
  }

  /** @param {import("./wire.js").Part[]} parts @param {number} now */
  take(parts, now) {
    for (const {kind, figure, view} of parts) {
      if (kind === POSE) {
        const pose = readPose(view);
        if (figure === this.figure) this.playout.heard(pose.stamp, now);
        const track = this.poses.get(figure) ?? new Track();
        this.poses.set(figure, track);
        track.push(pose);
      } else if (kind === CAMERA && figure === 0) this.cameras.push(readCamera(view));
      else if (kind === OVERLAY) {
        const overlay = readOverlay(view);
        this.overlays.set(overlay.topic, overlay);
      }
    }
  }

  /** The picture's rectangle in the page's pixels. @returns {import("./view.js").Rect} */
  picture() {
    const {left, top, width, height} = this.box, inner = letterbox(this.camera.aspect, width, height);
    return {...inner, left: left + inner.left, top: top + inner.top};
  }

  /** Draw one frame. @param {number} now ms */
  draw(now) {
    this.pace.update(now);
    const time = this.playout.at(now);
    const seen = this.cameras.around(this.playout.offset === Infinity ? Infinity : time);
    if (seen) this.camera = mixCameras(seen);
    for (const [index, figure] of this.figures) {
      const around = this.poses.get(index)?.around(time);
      if (this.replay && index === this.figure) figure.pose(this.replay.root, this.replay.rotations);
      else if (around) {
        const pose = mixPoses(around);
        figure.pose(pose.root, pose.rotations);
        if (index === this.figure) this.shown = {seq: pose.seq, echo: pose.echo, stamp: pose.stamp};
      }
    }
    this.paint();
  }

  paint() {
    const {gl, canvas, box, ground, painter, ink} = this;
    if (!ground || !painter || !ink || gl.isContextLost()) return;
    const ratio = Math.min(devicePixelRatio || 1, 2) * this.pace.scale;
    const width = Math.max(1, Math.round(box.width * ratio)), height = Math.max(1, Math.round(box.height * ratio));
    if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
    const {aspect} = this.camera, rect = letterbox(aspect, width, height), view = viewOf(this.camera);
    const figures = [...this.figures.values()];
    ground.cast(figures);
    gl.viewport(rect.left, height - rect.top - rect.height, rect.width, rect.height);
    gl.disable(gl.SCISSOR_TEST);
    const edge = this.look.back.map((v) => v * 0.94);
    gl.clearColor(edge[0], edge[1], edge[2], 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.SCISSOR_TEST);
    gl.scissor(Math.round(rect.left), Math.round(height - rect.top - rect.height), Math.round(rect.width), Math.round(rect.height));
    gl.clearColor(this.look.back[0], this.look.back[1], this.look.back[2], 1);
    gl.clear(gl.COLOR_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST);
    for (const figure of figures) painter.draw(figure, view);
    ground.draw(view, this.look);
    const parents = this.figures.get(this.figure)?.skeleton.parents ?? [];
    ink.letters.least = (LEAST_LETTERS * ratio) / rect.height;
    ink.draw(this.overlays.values(), view, aspect, this.look === LOOKS.dark, parents);
    this.calls = drawn.reset();
    for (const wish of this.wishes.splice(0)) wish();
  }
}
