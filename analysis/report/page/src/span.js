// The stretch of time that the lanes show, and how it is moved: wheel, two fingers, dragging, buttons.

export class Span {
  constructor(begin, end, onchange) {
    Object.assign(this, { begin, end: Math.max(end, begin + 1e-3), onchange });
    this.from = this.begin;
    this.to = this.end;
    this.width = 1; // pixels
  }

  get whole() {
    return this.from <= this.begin && this.to >= this.end;
  }

  x(time) {
    return ((time - this.from) / (this.to - this.from)) * this.width;
  }

  time(x) {
    return this.from + (x / this.width) * (this.to - this.from);
  }

  set(from, to) {
    const least = Math.min(0.5, this.end - this.begin);
    const length = Math.min(Math.max(to - from, least), this.end - this.begin);
    const start = Math.min(Math.max(from, this.begin), this.end - length);
    if (start === this.from && start + length === this.to) return;
    this.from = start;
    this.to = start + length;
    this.onchange();
  }

  zoom(factor, x = this.width / 2) {
    const at = this.time(x);
    this.set(at - (at - this.from) * factor, at + (this.to - at) * factor);
  }

  pan(pixels) {
    const seconds = (pixels / this.width) * (this.to - this.from);
    this.set(this.from + seconds, this.to + seconds);
  }

  // Turns a page when the time has left the stretch.
  follow(time) {
    const length = this.to - this.from;
    if (time < this.from || time > this.to) this.set(time - 0.1 * length, time + 0.9 * length);
  }

  // Moves by what fingers, mouse and wheel do on an element. `ontap(x, y, event)`: pressed without moving.
  listen(element, { ontap, wheelZooms = false }) {
    const fingers = new Map();
    let moved = 0;
    element.addEventListener("pointerdown", (event) => {
      if (event.button) return;
      fingers.set(event.pointerId, event.offsetX);
      if (fingers.size === 1) moved = 0;
      element.setPointerCapture(event.pointerId);
    });
    element.addEventListener("pointermove", (event) => {
      const before = fingers.get(event.pointerId);
      if (before === undefined) return;
      const others = [...fingers].filter(([id]) => id !== event.pointerId).map(([, x]) => x);
      fingers.set(event.pointerId, event.offsetX);
      moved += Math.abs(event.offsetX - before);
      if (moved < 4) return;
      if (others.length) {
        const apart = Math.max(Math.abs(before - others[0]), 8);
        const now = Math.max(Math.abs(event.offsetX - others[0]), 8);
        this.zoom(apart / now, (event.offsetX + others[0]) / 2);
      }
      this.pan((before - event.offsetX) / (others.length ? 2 : 1));
    });
    element.addEventListener("pointerup", (event) => {
      if (fingers.delete(event.pointerId) && moved < 4 && !fingers.size) {
        ontap(event.offsetX, event.offsetY, event);
      }
    });
    element.addEventListener("pointercancel", (event) => fingers.delete(event.pointerId));
    element.addEventListener(
      "wheel",
      (event) => {
        const across = event.shiftKey && !event.deltaX ? event.deltaY : event.deltaX;
        if (event.ctrlKey || event.metaKey || (wheelZooms && Math.abs(event.deltaY) > Math.abs(across))) {
          event.preventDefault();
          this.zoom(Math.exp(Math.max(Math.min(event.deltaY, 120), -120) * 0.004), event.offsetX);
        } else if (Math.abs(across) > Math.abs(event.deltaY) || event.shiftKey) {
          event.preventDefault();
          this.pan(across);
        }
      },
      { passive: false },
    );
  }
}

// Round times for an axis: at most one each `apart` pixels.
export function* roundTimes(span, apart) {
  const least = (apart / span.width) * (span.to - span.from);
  const power = 10 ** Math.floor(Math.log10(least));
  const step = [1, 2, 5, 10].map((m) => m * power).find((candidate) => candidate >= least);
  for (let k = Math.ceil(span.from / step); k * step <= span.to; k += 1) {
    yield { time: k * step, text: `${(k * step).toFixed(step < 1 ? (step < 0.1 ? 2 : 1) : 0)}` };
  }
}
