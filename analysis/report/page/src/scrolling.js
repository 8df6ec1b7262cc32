// Bringing something into sight without moving the page from under the reader.

const SMALL = matchMedia("(max-width: 760px)");

// Scrolls a list as far as an element of it is out of sight. On a small screen lists have no scroll bar of
// their own: there it is the panel that is scrolled.
export function bring(list, element) {
  const scroller = SMALL.matches ? scrollerOf(element) : list;
  if (!scroller?.clientHeight) return;
  const box = scroller.getBoundingClientRect();
  const { top, height } = element.getBoundingClientRect();
  if (top < box.top) scroller.scrollTop += top - box.top - 8;
  else if (top + height > box.bottom) {
    scroller.scrollTop += Math.min(top + height - box.bottom + 8, top - box.top - 8);
  }
}

// Calls back whenever an element comes into the page, as by a click on its tab.
export function onShown(element, callback) {
  let before = 0;
  new ResizeObserver(() => {
    const height = element.clientHeight;
    if (height && !before) callback();
    before = height;
  }).observe(element);
}

function scrollerOf(element) {
  for (let above = element.parentElement; above; above = above.parentElement) {
    const { overflowY } = getComputedStyle(above);
    if ((overflowY === "auto" || overflowY === "scroll") && above.scrollHeight > above.clientHeight) return above;
  }
  return null;
}
