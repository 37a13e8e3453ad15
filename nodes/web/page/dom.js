// Small helpers for the page's own controls.

/**
 * The element of an id, known to be there.
 * @template {HTMLElement} T
 * @param {string} id @param {{new (): T, prototype: T}} type @returns {T}
 */
export function byId(id, type) {
  const found = document.getElementById(id);
  if (!(found instanceof type)) throw new Error(`no ${type.name} #${id}`);
  return found;
}

/**
 * A new element.
 * @template {keyof HTMLElementTagNameMap} K
 * @param {K} tag @param {Record<string, unknown>} [fields] properties @param {(Node | string)[]} children
 * @returns {HTMLElementTagNameMap[K]}
 */
export function make(tag, fields = {}, ...children) {
  const one = document.createElement(tag);
  Object.assign(one, fields);
  one.append(...children);
  return one;
}

let hideAt = 0;

/** Tell something for a few seconds. @param {string} text */
export function toast(text) {
  const box = byId("toast", HTMLElement);
  box.textContent = text;
  box.classList.add("shown");
  clearTimeout(hideAt);
  hideAt = window.setTimeout(() => box.classList.remove("shown"), 2500 + 40 * text.length);
}

/** Run something that the stage may refuse, and tell why. @param {() => Promise<unknown>} work */
export async function attempt(work) {
  try {
    await work();
  } catch (error) {
    toast(error instanceof Error ? error.message : String(error));
  }
}
