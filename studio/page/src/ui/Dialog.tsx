// A modal dialog: Escape and a click beside it close it, and the focus returns to where it was.

import { useEffect, useId, useRef } from "react";
import type { ReactNode } from "react";

export function Dialog({ title, onClose, children, wide = false }: { title: string; onClose(): void; children: ReactNode; wide?: boolean }) {
  const dialog = useRef<HTMLDialogElement>(null);
  const heading = useId();
  useEffect(() => {
    const shown = dialog.current!;
    if (!shown.open) shown.showModal();
    return () => shown.close();
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
