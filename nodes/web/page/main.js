// Wires the page: what arrives goes to the stage, what the hands do goes to the outbox, once a frame.

import {Calibration} from "./calibrate.js";
import {Connection, Identity} from "./connection.js";
import {drawer, hideHint, offerFit, showNumbers, showState, takes, theme, ways} from "./controls.js";
import {attempt, byId, make, toast} from "./dom.js";
import {SliderHands} from "./hands.js";
import {LOOKS} from "./ground.js";
import {listenMouse, MouseFingers, MousePen} from "./mouse.js";
import {Outbox} from "./outbox.js";
import {Pads} from "./pad.js";
import {fingerKeys, handPanel, penPanel} from "./panels.js";
import {listenPen, PenSamples} from "./pen.js";
import {Stage} from "./stage.js";
import {Stats} from "./stats.js";
import {Contacts, listenTouch} from "./touch.js";
import {shareOf} from "./view.js";

const canvas = byId("view", HTMLCanvasElement);

function begin() {
  const stage = new Stage(canvas);
  const stats = new Stats();
  const calibration = new Calibration(localStorage);
  const contacts = new Contacts(), samples = new PenSamples(), hands = new SliderHands(), pads = new Pads();
  const fingers = new MouseFingers(contacts), pen = new MousePen(samples);
  /** What the stage says of this page. */
  const here = {role: "", figure: "", pages: 0, realPen: false};
  /** Whether what hands do here moves the figure: not where it watches, nor while it shows a take. */
  const plays = () => here.role === "play" && !stage.replay;

  const showPen = penPanel(pen), showHands = handPanel(hands);
  const way = ways(() => {
    fingers.release();
    pen.leave(performance.now());
    stage.measure();
  });
  theme((dark) => { stage.look = dark ? LOOKS.dark : LOOKS.light; });

  const identity = new Identity(sessionStorage, location, history);
  const outbox = new Outbox({contacts, samples, hands, pads}, (message) => connection.send(message));
  const connection = new Connection(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/socket`, identity, {
    state: showState,
    bundle: (parts, now) => stage.take(parts, now),
    welcome() {
      if (outbox.renew()) toast("The connection was lost, and the figure let go. Lift your hand and touch it again.");
      fingers.release();
      attempt(() => timeline.ask());
    },
    message(message) {
      if (message.t === "skeleton") attempt(() => stage.dress(message));
      else if (message.t === "take") {
        timeline.mark(message.name);
        if (!message.name) attempt(() => timeline.refresh());
      } else if (message.t === "welcome") {
        stage.renew(message.figures.length);
        showFigures(message.figures);
      }
      else if (message.t === "stage") showPart(message);
      else if (message.t === "heard") way.hear(message.ways);
    },
  });
  const timeline = takes(connection, () => here.figure);
  const settings = drawer(connection, calibration, () => stage.box.width / stage.box.height);

  // -- who this page is -------------------------------------------------------------------------------------------
  const figureList = byId("figure", HTMLSelectElement), roleList = byId("role", HTMLSelectElement);
  /** @type {string[]} */
  let figures = [""];
  /** @param {string[]} names */
  function showFigures(names) {
    figures = names;
    figureList.replaceChildren(...names.map((name) => make("option", {value: name, textContent: name || "the figure"})));
  }
  /** @param {{role: string, figure: string, pages: {page: string, role: string, figure: string}[]}} told */
  function showPart({role, figure, pages}) {
    Object.assign(here, {role, figure, pages: pages.length});
    connection.role = role;
    connection.figure = figureList.value = figure;
    roleList.value = role;
    stage.figure = Math.max(0, figures.indexOf(figure));
    const others = pages.length - 1, free = !pages.some((one) => one.figure === figure && one.role === "play");
    byId("playnow", HTMLButtonElement).hidden = role === "play" || !free;
    const line = role === "watch" ? "watching" : figure ? `playing ${figure}` : "";
    byId("part", HTMLElement).textContent = others ? `${line || "playing"}, ${others} more ${others > 1 ? "pages" : "page"}` : line;
  }
  const askPart = () => attempt(() => connection.call("role", {role: roleList.value, figure: figureList.value}));
  byId("playnow", HTMLButtonElement).onclick = () =>
    attempt(() => connection.call("role", {role: "play", figure: here.figure}));
  figureList.onchange = askPart;
  roleList.onchange = askPart;
  byId("reset", HTMLButtonElement).onclick = () => attempt(async () => {
    hands.relax();
    fingers.release();
    await connection.call("reset");
  });

  // -- hands on the stage -----------------------------------------------------------------------------------------
  const surface = {picture: () => stage.picture(), metres: () => calibration.metres};
  const fingerPen = byId("fingerpen", HTMLInputElement);
  /** @type {number | null} the finger that draws */
  let drawing = null;
  listenTouch(canvas, contacts, surface, (phase, touches) => {
    if (drawing === null && (way.way() !== "pen" || !fingerPen.checked)) return false;
    const touch = phase === "down" && drawing === null ? touches[0] : touches.find((one) => one.identifier === drawing);
    if (!touch) return true;
    const ends = phase === "up" || phase === "cancel";
    drawing = ends ? null : touch.identifier;
    pen.put(shareOf(surface.picture(), touch.clientX, touch.clientY), ends ? 0 : 1, performance.now());
    if (ends) pen.leave(performance.now());
    return true;
  });
  listenPen(canvas, samples, surface, () => {
    if (here.realPen) return;
    here.realPen = true;
    fingerPen.checked = false;
  });
  listenMouse(canvas, surface, {way: way.way, fingers, pen, hand: hands, changed: showPen});
  fingerKeys(hands, () => way.way() === "hands" && !settings.open);
  addEventListener("pointerdown", (event) => {
    if (!byId("ways", HTMLElement).contains(/** @type {Node} */ (event.target))) hideHint();
  });
  canvas.addEventListener("pointerdown", () => {
    if (stage.replay) toast("This is a take. Go back to live to play.");
    else if (here.role === "watch") toast("This page watches. Settings, Part: play.");
  });
  canvas.addEventListener("keydown", (event) => {
    if (event.key === "Escape") fingers.release();
  });
  const letGo = () => {
    contacts.endAll("cancel");
    fingers.release();
    pen.leave(performance.now());
    const now = nowOf(performance.now()), allowed = plays();
    outbox.flush(now, allowed);
    if (contacts.changed) outbox.flush(now, allowed); // a finger that was not yet told comes and goes
  };
  document.addEventListener("visibilitychange", () => {
    if (document.hidden) letGo();
  });
  addEventListener("pagehide", letGo);

  // -- every frame ------------------------------------------------------------------------------------------------
  /** @param {number} now */
  const nowOf = (now) => ({
    time: now,
    size: calibration.size(surface.picture()),
    handsActive: way.way() === "hands",
    pads: navigator.getGamepads?.() ?? [],
  });
  let last = performance.now(), told = 0;
  /** @param {number} frameTime */
  const frame = (frameTime) => {
    requestAnimationFrame(frame);
    const began = performance.now(), dt = Math.min(0.1, (frameTime - last) / 1000);
    last = frameTime;
    hands.update(dt);
    const replay = timeline.player.update(1000 * dt);
    if (replay && !stage.replay) letGo();
    if (!replay && stage.replay) outbox.renew();
    stage.replay = replay;
    outbox.flush(nowOf(began), plays());
    stage.draw(began);
    if (way.way() === "hands") showHands();
    timeline.show(began);
    if (began - told > 500) {
      told = began;
      stats.traffic(connection.bytes, began);
      showNumbers(stats, connection, here.pages);
      offerFit(stage, here.role === "play");
      byId("empty", HTMLElement).hidden = !here.role || stage.figures.size > 0;
    }
    stats.frame(began, performance.now(), stage.calls ?? 0, stage.shown.echo);
  };
  requestAnimationFrame(frame);
  Object.assign(window, {bunraku: {stage, stats, connection, outbox, contacts, samples, hands, here, calibration, timeline}});
}

try {
  begin();
} catch (error) {
  showState("broken", error instanceof Error ? error.message : String(error));
}
