// Light and dark: as the reader's system has it, until they choose.

const listeners = new Set();

export function startTheme() {
  const system = matchMedia("(prefers-color-scheme: dark)");
  const remembered = recall("theme");
  setTheme(remembered ?? (system.matches ? "dark" : "light"));
  system.addEventListener("change", () => {
    if (!recall("theme")) setTheme(system.matches ? "dark" : "light");
  });
}

export function switchTheme() {
  const wanted = document.documentElement.dataset.theme === "dark" ? "light" : "dark";
  remember("theme", wanted);
  setTheme(wanted);
}

// `callback` is called when the colours have changed, and once at the start.
export function onTheme(callback) {
  listeners.add(callback);
  callback();
}

// The value of a variable of the style sheet: colour("failure") is that of --failure.
export function colour(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
}

export function setTheme(theme) {
  document.documentElement.dataset.theme = theme;
  for (const callback of listeners) callback();
}

// What the reader chose, kept by the browser where it allows a file to keep something.
export function recall(key) {
  try {
    return localStorage.getItem(`picktree.report.${key}`);
  } catch {
    return null;
  }
}

export function remember(key, value) {
  try {
    localStorage.setItem(`picktree.report.${key}`, value);
  } catch {
    // Then it holds for this visit alone.
  }
}
