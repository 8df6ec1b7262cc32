import type { ReactNode } from "react";

// What to do first, where there is nothing yet.
export function Empty({ title, children }: { title: string; children?: ReactNode }) {
  return (
    <section className="empty-state">
      <h2>{title}</h2>
      {children}
    </section>
  );
}
