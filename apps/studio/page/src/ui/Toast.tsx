// Short messages at the edge of the page; they stay until they are closed when they say what went wrong.

import { useSyncExternalStore } from "react";
import { createPortal } from "react-dom";

import { CallError } from "../connection";
import { useTopDialog } from "./Dialog";

export type ToastKind = "success" | "failure" | "info";
interface Toast {
  id: number;
  text: string;
  kind: ToastKind;
  link?: { href: string; text: string };
}

const LASTS = 8000; // ms
const MOST = 5;
let toasts: Toast[] = [];
let next = 1;
const listeners = new Set<() => void>();

function set(now: Toast[]): void {
  toasts = now.slice(-MOST);
  for (const listener of listeners) listener();
}

export function toast(text: string, kind: ToastKind = "info", link?: Toast["link"]): void {
  const id = next++;
  set([...toasts, { id, text, kind, link }]);
  if (kind !== "failure") setTimeout(() => dismiss(id), LASTS);
}

export function toastError(error: unknown): void {
  const faults = error instanceof CallError ? error.faults : [];
  const text = faults.length ? faults.map((fault) => `${fault.file}:${fault.line}: ${fault.message}`).join("\n") : error instanceof Error ? error.message : String(error);
  toast(text, "failure");
}

function dismiss(id: number): void {
  set(toasts.filter((each) => each.id !== id));
}

export function Toasts() {
  const shown = useSyncExternalStore(
    (listener) => {
      listeners.add(listener);
      return () => listeners.delete(listener);
    },
    () => toasts,
  );
  const dialog = useTopDialog();
  const messages = (
    <div className="toasts" role="region" aria-label="Messages" aria-live="polite">
      {shown.map((each) => (
        <div key={each.id} className={`toast ${each.kind}`}>
          <span>{each.text}</span>
          {each.link && <a href={each.link.href} target={each.link.href.startsWith("#") ? undefined : "_blank"} rel="noreferrer">{each.link.text}</a>}
          <button className="icon" aria-label="Close this message" onClick={() => dismiss(each.id)}>×</button>
        </div>
      ))}
    </div>
  );
  return dialog ? createPortal(messages, dialog) : messages;
}
