// A modal dialog: Escape and a click beside it close it, and the focus returns to where it was.

import { useEffect, useId, useRef, useSyncExternalStore } from "react";
import type { ReactNode } from "react";

let open: HTMLElement[] = [];
const listeners = new Set<() => void>();

function setOpen(now: HTMLElement[]): void {
  open = now;
  for (const listener of listeners) listener();
}

// The uppermost dialog that is open, out of which nothing can be seen or reached; null without one.
export function useTopDialog(): HTMLElement | null {
  return useSyncExternalStore(
    (listener) => {
      listeners.add(listener);
      return () => listeners.delete(listener);
    },
    () => open[open.length - 1] ?? null,
  );
}

export function Dialog({ title, onClose, children, wide = false }: { title: string; onClose(): void; children: ReactNode; wide?: boolean }) {
  const dialog = useRef<HTMLDialogElement>(null);
  const heading = useId();
  useEffect(() => {
    const shown = dialog.current!;
    if (!shown.open) shown.showModal();
    setOpen([...open, shown]);
    return () => {
      setOpen(open.filter((each) => each !== shown));
      shown.close();
    };
  }, []);
  return (
    <dialog ref={dialog} className={wide ? "wide" : undefined} aria-labelledby={heading}
      onCancel={(event) => { event.preventDefault(); onClose(); }}
      onClick={(event) => { if (event.target === dialog.current) onClose(); }}>
      <div className="dialog-body">
        <header>
          <h2 id={heading}>{title}</h2>
          <button className="icon" aria-label="Close" title="Close (Esc)" onClick={onClose}>×</button>
        </header>
        {children}
      </div>
    </dialog>
  );
}
