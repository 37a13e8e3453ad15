// The stage's controls: ways of playing, reset, takes with their timeline, settings and numbers.

import {attempt, byId, make} from "./dom.js";
import {showParams} from "./params.js";
import {saving} from "./saving.js";
import {show} from "./stats.js";
import {clockText, lengthOf, Player, readTrack, takeName} from "./takes.js";
import {letterbox} from "./view.js";

/** @typedef {import("./connection.js").Connection} Connection */

const HELP = {
  "Touch": "Drag any part of the figure. More fingers hold more parts; a second finger may move another part.",
  "Touch with a mouse": "Drag with the left button. With Shift the finger stays where you let go; press on it to drag it again, Shift-click takes it away, Escape all. The wheel presses harder.",
  "Pen": "Draw on the ground where the figure shall walk. Tilt leans it, pressure makes it duck, lifting and landing jumps.",
  "Pen with a mouse": "The left button is the pen's tip. The wheel sets the pressure, with Shift how upright the pen is, with Alt where it leans.",
  "Hands": "Sliders and keys 1 to 5 (right) and 6 to 0 (left) bend fingers, with Shift they stretch. Drag on the stage moves the right hand, the wheel moves it to and fro. Choose an action in the plane, double click performs it.",
};
const HINTS = {
  touch: {fine: "Drag the figure. Shift leaves a finger down, the wheel presses harder.", coarse: "Drag the figure with one or more fingers."},
  pen: {fine: "Draw a path on the ground. The wheel sets pressure; Shift or Alt and wheel tilt the pen.", coarse: "Draw a path on the ground. Tilt leans, pressure ducks."},
  hands: {fine: "Drag moves the right hand. Double click in the plane performs.", coarse: "Sliders bend the fingers. Two taps in the plane perform."},
};

const ALONE = 60000; // ms without a touch: whoever played has left

/**
 * Ways of playing; `hear` says which of them the stage's nodes hear, and who has not chosen plays by the first of them.
 * @returns {{way(): string, hear(heard: string[]): void}} @param {(way: string) => void} changed
 */
export function ways(changed) {
  const box = byId("ways", HTMLFieldSetElement), hint = byId("hint", HTMLElement);
  /** @type {string[] | undefined} */
  let known;
  const tell = (/** @type {string} */ way) => {
    const kind = matchMedia("(pointer: coarse)").matches ? "coarse" : "fine";
    const hints = HINTS[/** @type {keyof typeof HINTS} */ (way)];
    hint.textContent = !known || known.includes(way) ? hints?.[kind] ?? "" : unheard(way, known);
  };
  const choose = (/** @type {string} */ way) => {
    document.body.dataset.way = way;
    tell(way);
    hint.classList.remove("away");
    for (const one of box.querySelectorAll("input")) one.checked = one.value === way;
    changed(way);
  };
  let chosen = sessionStorage.getItem("bunraku.way");
  choose(chosen ?? "touch");
  box.addEventListener("change", (event) => {
    chosen = /** @type {HTMLInputElement} */ (event.target).value;
    sessionStorage.setItem("bunraku.way", chosen);
    choose(chosen);
  });
  const way = () => document.body.dataset.way ?? "touch";
  return {way, hear(heard) {
    known = heard;
    if (!chosen && heard.length && heard[0] !== way()) choose(heard[0]);
    for (const one of box.querySelectorAll("input")) one.classList.toggle("idle", !heard.includes(one.value));
    tell(way());
  }};
}

/** Why nothing happens. @param {string} way @param {string[]} known */
export function unheard(way, known) {
  const instead = known.length ? ` It is played by ${known.join(" or ")}.` : "";
  return `This stage is not played by ${way}.${instead}`;
}

let hintAt = 0;

/** The hint goes when someone plays, and comes again for the next one. */
export function hideHint() {
  const hint = byId("hint", HTMLElement);
  hint.classList.add("away");
  clearTimeout(hintAt);
  hintAt = window.setTimeout(() => hint.classList.remove("away"), ALONE);
}

/** @type {Record<import("./connection.js").State, {word: string, title: string, line?: string}>} */
const STATES = {
  connecting: {word: "connecting", title: ""},
  open: {word: "connected", title: ""},
  lost: {word: "connection lost", title: "The connection is lost", line: "Trying again…"},
  refused: {word: "not let in", title: "Not let in"},
  broken: {word: "cannot be shown", title: "The stage cannot be shown here"},
};

/** @param {import("./connection.js").State} state @param {string} text why */
export function showState(state, text) {
  const box = byId("status", HTMLElement), lost = byId("lost", HTMLElement);
  box.dataset.state = state;
  const {word, title, line = text} = STATES[state];
  const [said, name, why] = [box.querySelector("span"), lost.querySelector("b"), lost.querySelector("span")];
  if (said) said.textContent = word;
  if (state === "open" || lost.classList.contains("late")) lost.hidden = true;
  if (!title || !name || !why) return;
  lost.classList.remove("late");
  lost.hidden = false;
  [name.textContent, why.textContent] = [title, line];
}

/**
 * Takes: begin, end, choose, play, scrub, save.
 * @param {Connection} connection @param {() => string} figure
 */
export function takes(connection, figure) {
  const player = new Player();
  const button = byId("take", HTMLButtonElement), list = byId("takes", HTMLSelectElement);
  const play = byId("play", HTMLButtonElement), scrub = byId("scrub", HTMLInputElement);
  const clock = byId("clock", HTMLOutputElement);
  let began = 0;
  let recording = "";

  const saves = saving(connection, () => ({name: list.value, figure: figure()}));
  const enable = () => {
    byId("live", HTMLButtonElement).hidden = !player.track;
    play.disabled = scrub.disabled = !player.track;
    saves();
  };
  const refresh = async () => {
    const {takes: found} = await connection.call("take.list");
    const chosen = list.value;
    list.replaceChildren(make("option", {value: "", textContent: "Live"}), ...found
      .filter((/** @type {{name: string}} */ one) => one.name !== recording)
      .map((/** @type {{name: string}} */ {name}) => {
        return make("option", {value: name, textContent: takeName(name, new Date())});
      }));
    list.value = chosen;
    if (list.selectedIndex < 0) list.value = "";
    enable();
  };
  const choose = async () => {
    player.load(null);
    enable();
    if (!list.value) return;
    const {url} = await connection.call("take.track", {name: list.value, figure: figure()});
    const answer = await fetch(url);
    if (!answer.ok) throw new Error("the take did not come");
    player.load(readTrack(await answer.arrayBuffer()));
    enable();
  };
  /** @param {string} name of the take that is being recorded, empty for none */
  const mark = (name) => {
    if (name && !recording) began = performance.now();
    recording = name;
    button.setAttribute("aria-pressed", String(name !== ""));
    const label = button.querySelector("span");
    if (label) label.textContent = name ? "Stop" : "Take";
  };
  button.onclick = () => attempt(async () => {
    if (!recording) {
      list.value = "";
      await choose();
      mark((await connection.call("take.start")).name);
      return;
    }
    const {name} = await connection.call("take.stop");
    mark("");
    await refresh();
    list.value = name;
    await choose();
  });
  list.onchange = () => attempt(choose);
  byId("live", HTMLButtonElement).onclick = () => {
    list.value = "";
    attempt(choose);
  };
  play.onclick = () => player.toggle();
  scrub.oninput = () => {
    player.playing = false;
    player.seek(Number(scrub.value));
  };
  return {
    player,
    refresh,
    mark,
    async ask() {
      const status = await connection.call("take.status");
      button.disabled = !status.recorder;
      button.title = status.recorder ? "" : status.why;
      mark(status.recording ? status.name : "");
      await refresh();
    },
    /** Show where the timeline stands. @param {number} now */
    show(now) {
      const shown = player.playing ? "❚❚" : "▶";
      if (play.textContent !== shown) {
        play.textContent = shown;
        play.setAttribute("aria-label", player.playing ? "Hold the take" : "Play the take");
      }
      if (player.track && (document.activeElement !== scrub || player.playing)) scrub.value = String(player.share);
      const time = recording ? now - began : player.track ? player.time : 0;
      const text = clockText(time);
      if (clock.textContent !== text) clock.textContent = text;
      const told = player.track ? `${text} of ${clockText(lengthOf(player.track))}` : text;
      if (scrub.ariaValueText !== told) scrub.ariaValueText = told;
    },
  };
}

/** Light or dark, as chosen or as the system has it. @param {(dark: boolean) => void} apply */
export function theme(apply) {
  const select = byId("theme", HTMLSelectElement), system = matchMedia("(prefers-color-scheme: dark)");
  select.value = localStorage.getItem("bunraku.theme") ?? "auto";
  const set = () => {
    const dark = select.value === "dark" || (select.value === "auto" && system.matches);
    document.documentElement.dataset.look = dark ? "dark" : "light";
    apply(dark);
  };
  select.onchange = () => {
    localStorage.setItem("bunraku.theme", select.value);
    set();
  };
  system.addEventListener("change", set);
  set();
}

/**
 * The settings' drawer.
 * @param {Connection} connection @param {import("./calibrate.js").Calibration} calibration
 * @param {() => number} shape width by height of the stage on this page
 */
export function drawer(connection, calibration, shape) {
  const box = byId("drawer", HTMLElement), button = byId("settings", HTMLButtonElement);
  /** @param {boolean} open */
  const set = (open) => {
    box.hidden = !open;
    button.setAttribute("aria-expanded", String(open));
    if (open) {
      attempt(() => showParams(connection));
      byId("closedrawer", HTMLButtonElement).focus();
    } else button.focus();
  };
  button.onclick = () => set(Boolean(box.hidden));
  byId("closedrawer", HTMLButtonElement).onclick = () => set(false);
  box.addEventListener("keydown", (event) => {
    if (event.key === "Escape") set(false);
  });
  byId("help", HTMLElement).replaceChildren(...Object.entries(HELP).flatMap(([name, text]) =>
    [make("dt", {textContent: name}), make("dd", {textContent: text})]));
  byId("fullscreen", HTMLButtonElement).onclick = () => attempt(async () => {
    if (document.fullscreenElement) await document.exitFullscreen();
    else await document.documentElement.requestFullscreen();
  });
  byId("fit", HTMLButtonElement).onclick = byId("fitnow", HTMLButtonElement).onclick = () => attempt(async () => {
    const value = Math.round(1000 * shape()) / 1000;
    const {nodes} = await connection.call("nodes");
    const owners = nodes.filter((/** @type {any} */ one) => one.params.aspect?.settable);
    if (!owners.length) throw new Error("No node of this stage has a picture of another shape.");
    for (const {node} of owners) await connection.call("param", {node, name: "aspect", value});
  });
  const width = byId("cardwidth", HTMLInputElement), card = byId("card", HTMLElement);
  const text = byId("cardtext", HTMLOutputElement);
  const shown = () => {
    width.value = String(calibration.pixels);
    card.style.setProperty("--card", `${calibration.pixels}px`);
    text.textContent = calibration.known ? `${(0.0254 / calibration.metres).toFixed(0)} pixels an inch` : "not measured";
  };
  width.oninput = () => {
    calibration.card(Number(width.value));
    shown();
  };
  byId("forgetcard", HTMLButtonElement).onclick = () => {
    calibration.forget();
    shown();
  };
  shown();
  return {get open() { return !box.hidden; }};
}

const WASTED = 0.6; // share of the stage below which the picture's shape is taken for the wrong one

/**
 * Offer to fit the picture where much of this screen is empty.
 * @param {import("./stage.js").Stage} stage @param {boolean} plays
 */
export function offerFit({camera, box}, plays) {
  const {width, height} = letterbox(camera.aspect, box.width, box.height);
  byId("fitnow", HTMLButtonElement).hidden = !plays || width * height > WASTED * box.width * box.height;
}

/**
 * Numbers on the bar and in the settings.
 * @param {import("./stats.js").Stats} stats @param {Connection} connection @param {number} pages
 */
export function showNumbers(stats, connection, pages) {
  const delay = stats.delay.percentile(0.5);
  byId("numbers", HTMLOutputElement).replaceChildren(
    ...[Number.isFinite(delay) ? `${show(delay)} ms` : "", `${show(stats.rate)} fps`].filter(Boolean)
      .map((textContent) => make("span", {textContent})));
  if (byId("drawer", HTMLElement).hidden) return;
  const box = byId("measured", HTMLElement);
  const rows = {
    "hand to picture": `${show(delay)} ms, p99 ${show(stats.delay.percentile(0.99))} ms`,
    "frames a second": show(stats.rate, 1),
    "script a frame": `${show(stats.script.percentile(0.5), 2)} ms, p95 ${show(stats.script.percentile(0.95), 2)} ms`,
    "draw calls": String(stats.calls),
    "received": `${show(stats.bytesPerSecond / 1000, 1)} kB/s`,
    "round trip": `${show(connection.roundTrip, 1)} ms`,
    "pages": String(pages),
  };
  box.replaceChildren(...Object.entries(rows).flatMap(([name, value]) =>
    [make("dt", {textContent: name}), make("dd", {textContent: value})]));
}
