// Icons of buttons, drawn on 24 × 24.

const PATHS = {
  play: '<path class="full" d="M8 5.5v13l10.5-6.5z"/>',
  pause: '<path d="M8.5 6v12M15.5 6v12" stroke-width="3.4"/>',
  back: '<path d="M15 6.5 9.5 12l5.5 5.5"/>',
  on: '<path d="M9 6.5l5.5 5.5L9 17.5"/>',
  failureBefore: '<path d="M10.5 6.5 5 12l5.5 5.5"/><path d="M17 6v8" stroke-width="2.6"/><circle class="full" cx="17" cy="18" r="0.6"/>',
  failureAfter: '<path d="M13.5 6.5 19 12l-5.5 5.5"/><path d="M7 6v8" stroke-width="2.6"/><circle class="full" cx="7" cy="18" r="0.6"/>',
  link: '<path d="M10 14a4 4 0 0 0 5.7 0l3-3A4 4 0 0 0 13 5.3l-1 1M14 10a4 4 0 0 0-5.7 0l-3 3A4 4 0 0 0 11 18.7l1-1"/>',
  done: '<path d="M5 12.5l4.5 4.5L19 7.5"/>',
  theme: '<circle cx="12" cy="12" r="8"/><path class="full" d="M12 4a8 8 0 0 1 0 16z"/>',
  help: '<path d="M8.8 9a3.3 3.3 0 1 1 4.9 2.9c-1.2.7-1.7 1.3-1.7 2.6"/><circle class="full" cx="12" cy="18" r="0.6"/>',
};

export function icon(name) {
  const holder = document.createElement("template");
  holder.innerHTML = `<svg viewBox="0 0 24 24" aria-hidden="true">${PATHS[name]}</svg>`;
  return holder.content.firstChild;
}
