"""What is wrong with a page to a person's eyes and fingers: asked of the browser's own layout."""

FAULTS = r"""() => {
  const light = ([r, g, b]) => {
    const [x, y, z] = [r, g, b].map((v) => (v <= 10 ? v / 255 / 12.92 : ((v / 255 + 0.055) / 1.055) ** 2.4));
    return 0.2126 * x + 0.7152 * y + 0.0722 * z;
  };
  const color = (text) => {
    const [r, g, b, a = 1] = text.match(/[\d.]+/g).map(Number), unit = text.startsWith('color(') ? 255 : 1;
    return [r * unit, g * unit, b * unit, a];
  };
  const over = (top, share, below) => below.map((v, k) => top[k] * share + v * (1 - share));
  const line = (one) => [one, ...(one.parentElement ? line(one.parentElement) : [])];
  const found = [];
  for (const one of document.querySelectorAll('body *')) {
    const box = one.getBoundingClientRect(), style = getComputedStyle(one), tree = line(one);
    if (box.width < 2 || box.height < 2 || style.visibility === 'hidden' || one.closest('.hidden')) continue;
    const seen = tree.reduce((share, up) => share * Number(getComputedStyle(up).opacity), 1);
    if (seen < 0.05) continue;
    const name = `${one.tagName.toLowerCase()}#${one.id} ${(one.ariaLabel ?? one.textContent).trim().slice(0, 24)}`;
    const fault = (what) => found.push(`${name}: ${what}`);
    const says = [...one.childNodes].some((node) => node.nodeType === 3 && node.textContent.trim());
    if (says) {
      if (parseFloat(style.fontSize) < 12) fault(`text of ${style.fontSize}`);
      const back = tree.map((up) => color(getComputedStyle(up).backgroundColor)).reverse()
        .reduce((below, top) => over(top, top[3], below), [255, 255, 255]);
      const [a, b] = [light(over(color(style.color), seen, back)), light(back)];
      const ratio = (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05);
      if (ratio < 4.5 && !one.closest(':disabled')) fault(`contrast of ${ratio.toFixed(1)}`);
      if (style.overflow !== 'visible' && one.scrollWidth > one.clientWidth + 1) fault('text is cut off');
    }
    if (one.matches('button, select, summary, input:not(.ways input), .ways span')) {
      const reach = (one.type === 'checkbox' && one.closest('label') || one).getBoundingClientRect();
      if (reach.width < 36 || reach.height < 36) fault(`${reach.width} x ${reach.height} pixels`);
      const scrolls = one.closest('aside, .panel');
      if (box.left < -1 || box.right > innerWidth + 1 || (!scrolls && (box.top < -1 || box.bottom > innerHeight + 1))) {
        fault(`reaches out of the screen: ${[box.left, box.top, box.right, box.bottom].map(Math.round)}`);
      }
    }
  }
  if (document.documentElement.scrollWidth > innerWidth) found.push('the page is wider than the screen');
  return found;
}"""
"""A script that lists text under 12 px, of little contrast or cut off, and controls that are small or out of reach."""
