<?xml version="1.0" encoding="utf-8"?>
<!DOCTYPE TS>
<TS version="2.1" language="de" sourcelanguage="en_US">
<context>
    <name>About</name>
    <message>
        <source>Free software under the Apache License 2.0.</source>
        <translation>Freie Software unter der Apache-Lizenz 2.0.</translation>
    </message>
    <message>
        <source>Calibration of multi-camera measuring rigs with an imperfect ball.</source>
        <translation>Kalibrierung von Mehrkamera-Messaufbauten mit einer unvollkommenen Kugel.</translation>
    </message>
    <message>
        <source>About SphereCal</source>
        <translation>Über SphereCal</translation>
    </message>
</context>
<context>
    <name>BallTab</name>
    <message>
        <source>Name of the ball</source>
        <translation>Name der Kugel</translation>
    </message>
    <message>
        <source>such as Ball hall 3</source>
        <translation>etwa Kugel Halle 3</translation>
    </message>
    <message>
        <source>Diameter (mm)</source>
        <translation>Durchmesser (mm)</translation>
    </message>
    <message>
        <source>A centimetre is near enough.</source>
        <translation>Auf einen Zentimeter genau genügt.</translation>
    </message>
    <message>
        <source>First target, no.</source>
        <translation>Erste Zielmarke, Nr.</translation>
    </message>
    <message>
        <source>Last target, no.</source>
        <translation>Letzte Zielmarke, Nr.</translation>
    </message>
    <message>
        <source>Width of a sticker (mm)</source>
        <translation>Breite eines Aufklebers (mm)</translation>
    </message>
    <message>
        <source>Measured on a sticker (mm)</source>
        <translation>Am Aufkleber gemessen (mm)</translation>
    </message>
    <message>
        <source>Printed scale</source>
        <translation>Druckmaßstab</translation>
    </message>
    <message>
        <source>Without a bar that gives the scale, this distance does, good to a percent.</source>
        <translation>Ohne Stab, der den Maßstab gibt, gilt dieser Abstand, auf ein Prozent genau.</translation>
    </message>
    <message>
        <source>Ball of the library</source>
        <translation>Kugel aus der Sammlung</translation>
    </message>
    <message>
        <source>Which ball?</source>
        <translation>Welche Kugel?</translation>
    </message>
    <message>
        <source>Targets from a file</source>
        <translation>Zielmarken aus einer Datei</translation>
    </message>
    <message>
        <source>By number and width</source>
        <translation>Nach Nummer und Breite</translation>
    </message>
    <message>
        <source>Target set</source>
        <translation>Zielmarkensatz</translation>
    </message>
    <message>
        <source>a new ball</source>
        <translation>eine neue Kugel</translation>
    </message>
</context>
<context>
    <name>Banner</name>
    <message>
        <source>Close this message</source>
        <translation>Meldung schließen</translation>
    </message>
</context>
<context>
    <name>Bars</name>
    <message>
        <source>Turn bar {bar} by {deg:.0f}°: from near {first} to near {last}</source>
        <translation>Stab {bar} um {deg:.0f}° drehen: von nahe {first} bis nahe {last}</translation>
    </message>
    <message>
        <source>It is in place. Wait until it is at rest</source>
        <translation>Er liegt richtig. Zur Ruhe kommen lassen</translation>
    </message>
    <message>
        <source>Ready: press space</source>
        <translation>Bereit: Leertaste drücken</translation>
    </message>
    <message>
        <source>Lay bar {bar} as in the picture, near {first}</source>
        <translation>Stab {bar} wie im Bild legen, nahe {first}</translation>
    </message>
    <message>
        <source>Lay bar {bar} as in the picture: from near {first} to near {last}</source>
        <translation>Stab {bar} wie im Bild legen: von nahe {first} bis nahe {last}</translation>
    </message>
    <message>
        <source>Move bar {bar} {mm:.0f} mm up</source>
        <translation>Stab {bar} {mm:.0f} mm nach oben</translation>
    </message>
    <message>
        <source>Move bar {bar} {mm:.0f} mm down</source>
        <translation>Stab {bar} {mm:.0f} mm nach unten</translation>
    </message>
    <message>
        <source>Move bar {bar} {mm:.0f} mm towards {camera}</source>
        <translation>Stab {bar} {mm:.0f} mm in Richtung {camera}</translation>
    </message>
    <message>
        <source>Pose {number} of {count}</source>
        <translation>Lage {number} von {count}</translation>
    </message>
</context>
<context>
    <name>BarsTab</name>
    <message>
        <source>Bars of this computer</source>
        <translation>Stäbe dieses Rechners</translation>
    </message>
    <message>
        <source>New bar</source>
        <translation>Neuer Stab</translation>
    </message>
    <message>
        <source>Remove</source>
        <translation>Entfernen</translation>
    </message>
    <message>
        <source>Import CSV</source>
        <translation>CSV einlesen</translation>
    </message>
    <message>
        <source>Export CSV</source>
        <translation>CSV ausgeben</translation>
    </message>
    <message>
        <source>2026-11-21</source>
        <translation>2026-11-21</translation>
    </message>
    <message>
        <source>Serial number</source>
        <translation>Seriennummer</translation>
    </message>
    <message>
        <source>Description</source>
        <translation>Was es ist</translation>
    </message>
    <message>
        <source>Expansion (10⁻⁶/K)</source>
        <translation>Ausdehnung (10⁻⁶/K)</translation>
    </message>
    <message>
        <source>Steel 11.5, aluminium 23, carbon fibre about 0.</source>
        <translation>Stahl 11.5, Aluminium 23, Kohlefaser etwa 0.</translation>
    </message>
    <message>
        <source>Lengths are valid at (°C)</source>
        <translation>Längen gelten bei (°C)</translation>
    </message>
    <message>
        <source>Certificate, no.</source>
        <translation>Zertifikat, Nr.</translation>
    </message>
    <message>
        <source>Laboratory</source>
        <translation>Labor</translation>
    </message>
    <message>
        <source>Calibrated on</source>
        <translation>Kalibriert am</translation>
    </message>
    <message>
        <source>Valid until</source>
        <translation>Gültig bis</translation>
    </message>
    <message>
        <source>On this bench</source>
        <translation>Bei diesen Messmitteln</translation>
    </message>
    <message>
        <source>is not here</source>
        <translation>liegt nicht bereit</translation>
    </message>
    <message>
        <source>gives the scale</source>
        <translation>gibt den Maßstab</translation>
    </message>
    <message>
        <source>verifies</source>
        <translation>prüft</translation>
    </message>
    <message>
        <source>Certified lengths (mm)</source>
        <translation>Zertifizierte Längen (mm)</translation>
    </message>
    <message>
        <source>Add a length</source>
        <translation>Noch eine Länge</translation>
    </message>
    <message>
        <source>Certificate and material</source>
        <translation>Zertifikat und Werkstoff</translation>
    </message>
    <message>
        <source>A table of bars</source>
        <translation>Eine Tabelle von Stäben</translation>
    </message>
    <message>
        <source>The table is in {file}.</source>
        <translation>Die Tabelle liegt in {file}.</translation>
    </message>
    <message>
        <source>new bar</source>
        <translation>neuer Stab</translation>
    </message>
    <message>
        <source>something is missing</source>
        <translation>etwas fehlt</translation>
    </message>
    <message>
        <source>Remove this length</source>
        <translation>Diese Länge entfernen</translation>
    </message>
</context>
<context>
    <name>Bench</name>
    <message>
        <source>Must be from {low} to {high}.</source>
        <translation>Muss von {low} bis {high} sein.</translation>
    </message>
    <message>
        <source>The certificate&apos;s number is missing.</source>
        <translation>Die Nummer des Zertifikats fehlt.</translation>
    </message>
    <message>
        <source>At least one certified length is needed.</source>
        <translation>Mindestens eine zertifizierte Länge ist nötig.</translation>
    </message>
    <message>
        <source>The number printed at the sticker, such as 201.</source>
        <translation>Die am Aufkleber gedruckte Nummer, etwa 201.</translation>
    </message>
    <message>
        <source>The length on the certificate, in mm.</source>
        <translation>Die Länge auf dem Zertifikat, in mm.</translation>
    </message>
    <message>
        <source>{count} targets, nos. {first}-{last}, {width} mm</source>
        <translation>{count} Zielmarken, Nr. {first}-{last}, {width} mm</translation>
    </message>
    <message>
        <source>A whole number, as printed at the stickers.</source>
        <translation>Eine ganze Zahl, wie auf die Aufkleber gedruckt.</translation>
    </message>
    <message>
        <source>A name by which you know the ball.</source>
        <translation>Ein Name, an dem Sie die Kugel erkennen.</translation>
    </message>
    <message>
        <source>Measure it with a tape: a centimetre is near enough.</source>
        <translation>Mit dem Maßband messen: auf einen Zentimeter genau genügt.</translation>
    </message>
    <message>
        <source>{first} and {second} are {mm:.2f} mm apart as designed: measure these two, in mm.</source>
        <translation>{first} und {second} sind im Entwurf {mm:.2f} mm voneinander entfernt: diese beiden messen, in mm.</translation>
    </message>
    <message>
        <source>Measure from dot {first} to dot {second} of a sticker with a caliper: {mm:.2f} mm as designed.</source>
        <translation>Mit dem Messschieber von Punkt {first} bis Punkt {second} eines Aufklebers messen: im Entwurf {mm:.2f} mm.</translation>
    </message>
    <message>
        <source>Printed {percent:.2f} % too large.</source>
        <translation>{percent:.2f} % zu groß gedruckt.</translation>
    </message>
    <message>
        <source>Printed {percent:.2f} % too small.</source>
        <translation>{percent:.2f} % zu klein gedruckt.</translation>
    </message>
    <message>
        <source>Printers err by 0.5 % at most: this is as usual.</source>
        <translation>Drucker weichen höchstens 0.5 % ab: Das ist üblich.</translation>
    </message>
    <message>
        <source>More than printers err: print at 100 %, without fitting to the page, or give the width as printed.</source>
        <translation>Mehr, als Drucker abweichen: mit 100 % drucken, ohne Anpassen an die Seite, oder die gedruckte Breite angeben.</translation>
    </message>
    <message>
        <source>From {low} to {high} placements of the ball.</source>
        <translation>Von {low} bis {high} Aufstellungen der Kugel.</translation>
    </message>
    <message>
        <source>Another bar has this serial number.</source>
        <translation>Ein anderer Stab hat diese Seriennummer.</translation>
    </message>
    <message>
        <source>Only one bar gives the scale; {bar} does already.</source>
        <translation>Nur ein Stab gibt den Maßstab; {bar} tut es schon.</translation>
    </message>
    <message>
        <source>Sticker {number} is none of the ball&apos;s target set ({targets}).</source>
        <translation>Aufkleber {number} gehört nicht zum Zielmarkensatz der Kugel ({targets}).</translation>
    </message>
    <message>
        <source>Sticker {number} is on bar {bar} as well.</source>
        <translation>Aufkleber {number} ist auch auf Stab {bar}.</translation>
    </message>
    <message>
        <source>Nothing gives the scale: lengths will be arbitrary.</source>
        <translation>Nichts gibt den Maßstab: Längen werden beliebig sein.</translation>
    </message>
    <message>
        <source>No bar verifies: the calibration cannot be verified.</source>
        <translation>Kein Stab prüft: Die Kalibrierung lässt sich nicht verifizieren.</translation>
    </message>
    <message>
        <source>Ball {mm} mm</source>
        <translation>Kugel {mm} mm</translation>
    </message>
    <message>
        <source>incomplete</source>
        <translation>noch unvollständig</translation>
    </message>
    <message>
        <source>Bars taken over: {count}.</source>
        <translation>Übernommene Stäbe: {count}.</translation>
    </message>
    <message>
        <source>With other figures than the library&apos;s, which can be undone: {bars}.</source>
        <translation>Mit anderen Zahlen als in der Sammlung, was sich rückgängig machen lässt: {bars}.</translation>
    </message>
    <message>
        <source>Lines that could not be used: {count}.</source>
        <translation>Nicht verwendbare Zeilen: {count}.</translation>
    </message>
    <message>
        <source>It holds for the real rig, not for this training.</source>
        <translation>Es gilt für den wirklichen Aufbau, nicht für diese Übung.</translation>
    </message>
    <message>
        <source>It applies to the next calibration: this one already has images.</source>
        <translation>Es gilt ab der nächsten Kalibrierung: Diese hat schon Bilder.</translation>
    </message>
    <message>
        <source>It holds for this calibration and the next ones.</source>
        <translation>Es gilt für diese und die nächsten Kalibrierungen.</translation>
    </message>
    <message>
        <source>It applies to the next calibrations of this rig.</source>
        <translation>Es gilt für die nächsten Kalibrierungen dieses Aufbaus.</translation>
    </message>
</context>
<context>
    <name>BenchDialog</name>
    <message>
        <source>The bench: ball, bars, limits</source>
        <translation>Die Messmittel: Kugel, Stäbe, Grenzen</translation>
    </message>
    <message>
        <source>Ball</source>
        <translation>Kugel</translation>
    </message>
    <message>
        <source>Bars</source>
        <translation>Stäbe</translation>
    </message>
    <message>
        <source>Placements and limits</source>
        <translation>Aufstellungen und Grenzen</translation>
    </message>
    <message>
        <source>Undo</source>
        <translation>Rückgängig</translation>
    </message>
    <message>
        <source>Redo</source>
        <translation>Wiederholen</translation>
    </message>
    <message>
        <source>Save</source>
        <translation>Speichern</translation>
    </message>
    <message>
        <source>Close</source>
        <translation>Schließen</translation>
    </message>
    <message>
        <source>Nothing was changed.</source>
        <translation>Nichts wurde geändert.</translation>
    </message>
    <message>
        <source>Nothing was undone.</source>
        <translation>Nichts wurde rückgängig gemacht.</translation>
    </message>
    <message>
        <source>To be corrected before saving: {count}</source>
        <translation>Vor dem Speichern zu berichtigen: {count}</translation>
    </message>
    <message>
        <source>No ball is described: only the library of bars is saved.</source>
        <translation>Keine Kugel ist beschrieben: Nur die Sammlung der Stäbe wird gespeichert.</translation>
    </message>
    <message>
        <source>Close without saving</source>
        <translation>Schließen, ohne zu speichern</translation>
    </message>
    <message>
        <source>and {count} more</source>
        <translation>und {count} weitere</translation>
    </message>
    <message>
        <source>Saved. {holds}</source>
        <translation>Gespeichert. {holds}</translation>
    </message>
    <message>
        <source>Something was changed and is not saved.</source>
        <translation>Es wurde etwas geändert und nicht gespeichert.</translation>
    </message>
    <message>
        <source>Do not save</source>
        <translation>Nicht speichern</translation>
    </message>
    <message>
        <source>Go on editing</source>
        <translation>Weiter bearbeiten</translation>
    </message>
</context>
<context>
    <name>BoardDialog</name>
    <message>
        <source>Calibrate with a board</source>
        <translation>Mit einer Tafel kalibrieren</translation>
    </message>
    <message>
        <source>No ball is needed. Show the board in a dozen places and tilts, to two cameras at a time.</source>
        <translation>Es braucht keine Kugel. Die Tafel an einem Dutzend Stellen und in verschiedenen Neigungen zeigen, je zwei Kameras zugleich.</translation>
    </message>
    <message>
        <source>Board</source>
        <translation>Tafel</translation>
    </message>
    <message>
        <source>The images show the rest (rows, columns, markers)</source>
        <translation>Den Rest zeigen die Bilder (Zeilen, Spalten, Marker)</translation>
    </message>
    <message>
        <source>Save a sheet to print</source>
        <translation>Druckvorlage speichern</translation>
    </message>
    <message>
        <source>Calibrate with this board</source>
        <translation>Mit dieser Tafel kalibrieren</translation>
    </message>
    <message>
        <source>Images of this board</source>
        <translation>Bilder dieser Tafel</translation>
    </message>
    <message>
        <source>Chessboard</source>
        <translation>Schachbrett</translation>
    </message>
    <message>
        <source>Circles</source>
        <translation>Kreise</translation>
    </message>
    <message>
        <source>Circles, asymmetric</source>
        <translation>Kreise, versetzt</translation>
    </message>
    <message>
        <source>Rows of tags</source>
        <translation>Zeilen von Tags</translation>
    </message>
    <message>
        <source>Rows of inner corners</source>
        <translation>Zeilen innerer Ecken</translation>
    </message>
    <message>
        <source>Rows of dots</source>
        <translation>Zeilen von Punkten</translation>
    </message>
    <message>
        <source>Columns of tags</source>
        <translation>Spalten von Tags</translation>
    </message>
    <message>
        <source>Columns of inner corners</source>
        <translation>Spalten innerer Ecken</translation>
    </message>
    <message>
        <source>Columns of dots</source>
        <translation>Spalten von Punkten</translation>
    </message>
    <message>
        <source>Side of a square</source>
        <translation>Seite eines Feldes</translation>
    </message>
    <message>
        <source>From tag to tag</source>
        <translation>Abstand der Tags</translation>
    </message>
    <message>
        <source>From row to row</source>
        <translation>Von Zeile zu Zeile</translation>
    </message>
    <message>
        <source>Side of a marker</source>
        <translation>Seite des Markers</translation>
    </message>
    <message>
        <source>OpenCV&apos;s name of the markers</source>
        <translation>OpenCVs Name der Marker</translation>
    </message>
</context>
<context>
    <name>Bundle</name>
    <message>
        <source>Support bundle</source>
        <translation>Support-Paket</translation>
    </message>
    <message>
        <source>Save a support bundle of {n} files? It contains no images.</source>
        <translation>Ein Support-Paket aus {n} Dateien speichern? Es enthält keine Bilder.</translation>
    </message>
    <message>
        <source>Save</source>
        <translation>Speichern</translation>
    </message>
</context>
<context>
    <name>Calibrate</name>
    <message>
        <source>The calibration is finished: {verdict}.</source>
        <translation>Die Kalibrierung ist fertig: {verdict}.</translation>
    </message>
    <message>
        <source>The frame has changed: it was that of {before}, now it is that of {now}.</source>
        <translation>Das Koordinatensystem hat sich geändert: Es war das von {before}, jetzt ist es das von {now}.</translation>
    </message>
    <message>
        <source>{before} could not be placed. Coordinates of before do not fit these.</source>
        <translation>Die Pose von {before} war nicht bestimmbar. Frühere Koordinaten passen nicht zu diesen.</translation>
    </message>
    <message>
        <source>Cancelled. What was captured is kept.</source>
        <translation>Abgebrochen. Was aufgenommen ist, bleibt erhalten.</translation>
    </message>
</context>
<context>
    <name>CalibratePage</name>
    <message>
        <source>Stop here</source>
        <translation>Hier aufhören</translation>
    </message>
    <message>
        <source>What goes into it</source>
        <translation>Was eingeht</translation>
    </message>
    <message>
        <source>Captured</source>
        <translation>Aufgenommen</translation>
    </message>
    <message>
        <source>cameras</source>
        <translation>Kameras</translation>
    </message>
    <message>
        <source>dots</source>
        <translation>Punkte</translation>
    </message>
    <message>
        <source>state</source>
        <translation>Zustand</translation>
    </message>
    <message>
        <source>Green: where each camera has seen dots, over all placements.</source>
        <translation>Grün: wo jede Kamera Punkte gesehen hat, über alle Aufstellungen.</translation>
    </message>
    <message>
        <source>Stages</source>
        <translation>Schritte der Rechnung</translation>
    </message>
    <message>
        <source>Convergence</source>
        <translation>Konvergenz</translation>
    </message>
    <message>
        <source>Details</source>
        <translation>Einzelheiten</translation>
    </message>
    <message>
        <source>Log</source>
        <translation>Protokoll</translation>
    </message>
    <message>
        <source>Log of the computation</source>
        <translation>Protokoll der Rechnung</translation>
    </message>
    <message>
        <source>ours (recommended)</source>
        <translation>unseres (empfohlen)</translation>
    </message>
    <message>
        <source>the paper&apos;s (Tao et al., 2021)</source>
        <translation>das der Veröffentlichung (Tao u. a., 2021)</translation>
    </message>
    <message>
        <source>Method of the calibration</source>
        <translation>Verfahren der Kalibrierung</translation>
    </message>
    <message>
        <source>Method</source>
        <translation>Verfahren</translation>
    </message>
    <message>
        <source>captured</source>
        <translation>aufgenommen</translation>
    </message>
    <message>
        <source>not captured</source>
        <translation>nicht aufgenommen</translation>
    </message>
    <message>
        <source>The last calibration is valid and would be lost: cancel instead.</source>
        <translation>Die letzte Kalibrierung ist gültig und ginge verloren: stattdessen abbrechen.</translation>
    </message>
    <message>
        <source>It was asked for.</source>
        <translation>Schon verlangt.</translation>
    </message>
    <message>
        <source>Ends as soon as there is something to look at. Such a result is not valid.</source>
        <translation>Endet, sobald es etwas anzusehen gibt. Ein solches Ergebnis ist nicht gültig.</translation>
    </message>
    <message>
        <source>Done when the line falls no more. Each adjustment goes on where the one before ended.</source>
        <translation>Fertig, wenn die Linie nicht mehr fällt. Jede Ausgleichung beginnt, wo die vorige endete.</translation>
    </message>
    <message>
        <source>With the paper&apos;s method lengths are less certain. The report names the method.</source>
        <translation>Mit dem Verfahren der Veröffentlichung sind Längen weniger sicher. Der Bericht nennt das Verfahren.</translation>
    </message>
    <message>
        <source>Calibrate again</source>
        <translation>Neu kalibrieren</translation>
    </message>
</context>
<context>
    <name>CameraDialog</name>
    <message>
        <source>Hold a hand before a lens: the picture that goes dark is that camera&apos;s.</source>
        <translation>Eine Hand vor ein Objektiv halten: Das Bild, das dunkel wird, gehört zu dieser Kamera.</translation>
    </message>
    <message>
        <source>Let its light blink</source>
        <translation>Leuchte blinken lassen</translation>
    </message>
    <message>
        <source>These cameras have no light.</source>
        <translation>Diese Kameras haben keine Leuchte.</translation>
    </message>
    <message>
        <source>Name</source>
        <translation>Name</translation>
    </message>
    <message>
        <source>Exposure</source>
        <translation>Belichtung</translation>
    </message>
    <message>
        <source>Gain</source>
        <translation>Verstärkung</translation>
    </message>
    <message>
        <source>Trigger of all cameras</source>
        <translation>Auslösung aller Kameras</translation>
    </message>
    <message>
        <source>Software, one after the other</source>
        <translation>Software, nacheinander</translation>
    </message>
    <message>
        <source>Common clock (IEEE 1588), all at once</source>
        <translation>Gemeinsame Uhr (IEEE 1588), alle zugleich</translation>
    </message>
    <message>
        <source>Trigger box, all at once</source>
        <translation>Auslösegerät, alle zugleich</translation>
    </message>
    <message>
        <source>None: free running</source>
        <translation>Keine: freilaufend</translation>
    </message>
    <message>
        <source>Apply</source>
        <translation>Übernehmen</translation>
    </message>
    <message>
        <source>Close</source>
        <translation>Schließen</translation>
    </message>
    <message>
        <source>Work is running.</source>
        <translation>Es wird gearbeitet.</translation>
    </message>
    <message>
        <source>Its light blinks for some seconds.</source>
        <translation>Ihre Leuchte blinkt einige Sekunden.</translation>
    </message>
    <message>
        <source>This camera has no light that can be switched.</source>
        <translation>Diese Kamera hat keine schaltbare Leuchte.</translation>
    </message>
</context>
<context>
    <name>CameraRow</name>
    <message>
        <source>{name} in this rig</source>
        <translation>{name} in diesem Aufbau</translation>
    </message>
    <message>
        <source>Which is it?</source>
        <translation>Welche ist das?</translation>
    </message>
    <message>
        <source>Its picture, its name, exposure and gain; its light, where it has one.</source>
        <translation>Ihr Bild, ihr Name, Belichtung und Verstärkung; ihr Licht, wenn sie eins hat.</translation>
    </message>
    <message>
        <source>Address</source>
        <translation>Adresse</translation>
    </message>
    <message>
        <source>Give it an address</source>
        <translation>Adresse geben</translation>
    </message>
    <message>
        <source>A free one of this computer&apos;s network, kept in the camera.</source>
        <translation>Eine freie aus dem Netz dieses Rechners; die Kamera behält sie.</translation>
    </message>
    <message>
        <source>Placements are captured already: begin a new calibration.</source>
        <translation>Es sind schon Aufstellungen aufgenommen: eine neue Kalibrierung beginnen.</translation>
    </message>
    <message>
        <source>Work is running.</source>
        <translation>Es läuft eine Arbeit.</translation>
    </message>
    <message>
        <source>In this rig: whoever is left out is not opened and hinders nobody.</source>
        <translation>In diesem Aufbau: Wer weggelassen ist, wird nicht geöffnet und stört niemanden.</translation>
    </message>
    <message>
        <source>Driver</source>
        <translation>Treiber</translation>
    </message>
    <message>
        <source>Use the built-in driver</source>
        <translation>Eingebauten Treiber verwenden</translation>
    </message>
    <message>
        <source>For GigE and USB3 Vision cameras of any maker.</source>
        <translation>Für GigE- und USB3-Vision-Kameras aller Hersteller.</translation>
    </message>
</context>
<context>
    <name>CameraTile</name>
    <message>
        <source>no image yet</source>
        <translation>noch kein Bild</translation>
    </message>
    <message>
        <source>{count} dots</source>
        <translation>{count} Punkte</translation>
    </message>
    <message>
        <source>Name of the camera</source>
        <translation>Name der Kamera</translation>
    </message>
</context>
<context>
    <name>Cameras</name>
    <message>
        <source>Another program is using it. Close that program.</source>
        <translation>Ein anderes Programm benutzt sie. Dieses Programm schließen.</translation>
    </message>
</context>
<context>
    <name>Check</name>
    <message>
        <source>REPAIRED</source>
        <translation>REPARIERT</translation>
    </message>
    <message>
        <source>Not in use yet.</source>
        <translation>Noch nicht in Gebrauch.</translation>
    </message>
    <message>
        <source>The measured lengths of the bars agree with their certificates; single cameras were not checked.</source>
        <translation>Die Stäbe werden gemessen wie zertifiziert; einzelne Kameras wurden nicht geprüft.</translation>
    </message>
    <message>
        <source>The rig is as it was calibrated: {count} cameras agree with one another.</source>
        <translation>Der Aufbau ist wie kalibriert: {count} Kameras stimmen überein.</translation>
    </message>
    <message>
        <source>Only {camera} moved ({px} px). Tighten its mount.</source>
        <translation>Nur {camera} hat sich bewegt ({px} px). Halterung festziehen.</translation>
    </message>
    <message>
        <source>Moved: {cameras}.</source>
        <translation>Bewegt: {cameras}.</translation>
    </message>
    <message>
        <source>Less sharp than before: {cameras}.</source>
        <translation>Weniger scharf als zuvor: {cameras}.</translation>
    </message>
    <message>
        <source>{cameras} repaired: a point was off by {before:.3f} mm, now by {now:.3f} mm.</source>
        <translation>{cameras} repariert: Ein Punkt war um {before:.3f} mm falsch, jetzt um {now:.3f} mm.</translation>
    </message>
    <message>
        <source>{cameras} repaired and in use: {before:.3f} mm before, {now:.3f} mm now.</source>
        <translation>{cameras} repariert und in Gebrauch: vorher {before:.3f} mm, jetzt {now:.3f} mm.</translation>
    </message>
    <message>
        <source>A camera must be recalibrated where a point is off by more than {mm:.3f} mm.</source>
        <translation>Eine Kamera muss neu kalibriert werden, wo ein Punkt um mehr als {mm:.3f} mm falsch liegt.</translation>
    </message>
    <message>
        <source>Not checked, since they saw too little: {cameras}.</source>
        <translation>Nicht geprüft, weil sie zu wenig sahen: {cameras}.</translation>
    </message>
    <message>
        <source>The ball is measured {ppm:+.0f} ± {sd:.0f} ppm against the calibration.</source>
        <translation>Die Kugel wird {ppm:+.0f} ± {sd:.0f} ppm gegenüber der Kalibrierung gemessen.</translation>
    </message>
    <message>
        <source>The check is finished: {verdict}.</source>
        <translation>Die Prüfung ist fertig: {verdict}.</translation>
    </message>
    <message>
        <source>The repair is finished: {verdict}.</source>
        <translation>Die Reparatur ist fertig: {verdict}.</translation>
    </message>
    <message>
        <source>The repaired calibration is in use, as number {number}.</source>
        <translation>Die reparierte Kalibrierung ist in Gebrauch, als Nummer {number}.</translation>
    </message>
    <message>
        <source>repaired after a check: {cameras}</source>
        <translation>nach einer Prüfung repariert: {cameras}</translation>
    </message>
</context>
<context>
    <name>CheckPage</name>
    <message>
        <source>Calibrate the rig</source>
        <translation>Aufbau kalibrieren</translation>
    </message>
    <message>
        <source>Camera</source>
        <translation>Kamera</translation>
    </message>
    <message>
        <source>state</source>
        <translation>Zustand</translation>
    </message>
    <message>
        <source>moved
px</source>
        <translation>bewegt
px</translation>
    </message>
    <message>
        <source>a point is off
mm</source>
        <translation>Punkt falsch um
mm</translation>
    </message>
    <message>
        <source>shift
mm</source>
        <translation>Verschiebung
mm</translation>
    </message>
    <message>
        <source>turn
deg</source>
        <translation>Drehung
Grad</translation>
    </message>
    <message>
        <source>rms now
px</source>
        <translation>RMS jetzt
px</translation>
    </message>
    <message>
        <source>rms then
px</source>
        <translation>RMS damals
px</translation>
    </message>
    <message>
        <source>Repair</source>
        <translation>Reparieren</translation>
    </message>
    <message>
        <source>Calibrates only the cameras that moved, from this placement; seconds.</source>
        <translation>Kalibriert in Sekunden nur die bewegten Kameras, aus dieser Aufstellung.</translation>
    </message>
    <message>
        <source>Put the repair to use</source>
        <translation>Reparatur einsetzen</translation>
    </message>
    <message>
        <source>Repair {cameras}</source>
        <translation>{cameras} reparieren</translation>
    </message>
    <message>
        <source>The repair is not valid: calibrate the rig.</source>
        <translation>Die Reparatur ist nicht gültig: den Aufbau kalibrieren.</translation>
    </message>
    <message>
        <source>No bar has verified it, and the limits forbid its use: calibrate the rig and verify it.</source>
        <translation>Kein Stab hat sie verifiziert, und die Grenzwerte verbieten ihren Gebrauch: den Aufbau kalibrieren und verifizieren.</translation>
    </message>
    <message>
        <source>Check again to see the numbers.</source>
        <translation>Erneut prüfen zeigt die Zahlen.</translation>
    </message>
    <message>
        <source>Check again</source>
        <translation>Erneut prüfen</translation>
    </message>
</context>
<context>
    <name>Connect</name>
    <message>
        <source>missing: plug it in, then search again</source>
        <translation>fehlt: anstecken, dann erneut suchen</translation>
    </message>
    <message>
        <source>{count} called {name}</source>
        <translation>{count} mit Namen {name}</translation>
    </message>
    <message>
        <source>left out of the rig</source>
        <translation>gehört nicht zum Aufbau</translation>
    </message>
    <message>
        <source>It answers, but no driver reaches it.</source>
        <translation>Sie antwortet, aber kein Treiber erreicht sie.</translation>
    </message>
    <message>
        <source>It answers, but no driver reaches it: install {package}.</source>
        <translation>Sie antwortet, aber kein Treiber erreicht sie: {package} installieren.</translation>
    </message>
    <message>
        <source>Its address {address} is in another subnet than this computer.</source>
        <translation>Ihre Adresse {address} liegt in einem anderen Subnetz als dieser Rechner.</translation>
    </message>
    <message>
        <source>simulated {size}</source>
        <translation>simuliert {size}</translation>
    </message>
    <message>
        <source>not opened</source>
        <translation>nicht geöffnet</translation>
    </message>
    <message>
        <source>link: {share:.0f} % of the images damaged. Check cable, switch and packet size.</source>
        <translation>Verbindung: {share:.0f} % der Bilder beschädigt. Kabel, Switch und Paketgröße prüfen.</translation>
    </message>
    <message>
        <source>ready</source>
        <translation>bereit</translation>
    </message>
    <message>
        <source>Looking for cameras</source>
        <translation>Kameras werden gesucht</translation>
    </message>
    <message>
        <source>Cameras that answer, but cannot be used yet: {count}</source>
        <translation>Kameras, die antworten, aber noch nicht benutzbar sind: {count}</translation>
    </message>
    <message>
        <source>No cameras yet</source>
        <translation>Noch keine Kameras</translation>
    </message>
    <message>
        <source>{good} of {all} cameras ready</source>
        <translation>{good} von {all} Kameras bereit</translation>
    </message>
    <message>
        <source>{good} of {all} cameras ready, without {cameras}</source>
        <translation>{good} von {all} Kameras bereit, ohne {cameras}</translation>
    </message>
    <message>
        <source>{nominal} nominal, {certified} certified</source>
        <translation>nominal {nominal}, zertifiziert {certified}</translation>
    </message>
    <message>
        <source>This recording is damaged.</source>
        <translation>Diese Aufnahme ist beschädigt.</translation>
    </message>
    <message>
        <source>This folder contains no recording.</source>
        <translation>In diesem Ordner ist keine Aufnahme.</translation>
    </message>
    <message>
        <source>not known: describe the bench</source>
        <translation>nicht bekannt: die Messmittel beschreiben</translation>
    </message>
    <message>
        <source>Targets</source>
        <translation>Zielmarken</translation>
    </message>
    <message>
        <source>none: lengths will be arbitrary</source>
        <translation>keiner: Längen werden beliebig</translation>
    </message>
    <message>
        <source>none: the result cannot be verified</source>
        <translation>keiner: Das Ergebnis kann nicht verifiziert werden</translation>
    </message>
    <message>
        <source>Certificates</source>
        <translation>Zertifikate</translation>
    </message>
    <message>
        <source>Targets on the ball</source>
        <translation>Zielmarken auf der Kugel</translation>
    </message>
    <message>
        <source>Ball, about</source>
        <translation>Kugel, etwa</translation>
    </message>
    <message>
        <source>Scale from</source>
        <translation>Maßstab aus</translation>
    </message>
    <message>
        <source>Verified by</source>
        <translation>Verifiziert durch</translation>
    </message>
    <message>
        <source>It is not known which targets are on the ball.</source>
        <translation>Es ist nicht bekannt, welche Zielmarken auf der Kugel sind.</translation>
    </message>
    <message>
        <source>Choose the file that describes the bench.</source>
        <translation>Die Datei wählen, die die Messmittel beschreibt.</translation>
    </message>
    <message>
        <source>The names come from the recording or the simulated rig.</source>
        <translation>Die Namen stammen aus der Aufnahme oder dem simulierten Aufbau.</translation>
    </message>
    <message>
        <source>Placements were captured under this name: begin a new calibration to change it.</source>
        <translation>Unter diesem Namen wurden schon Aufstellungen aufgenommen: Für einen anderen eine neue Kalibrierung beginnen.</translation>
    </message>
    <message>
        <source>The description of the bench names this camera.</source>
        <translation>Die Beschreibung der Messmittel benennt diese Kamera.</translation>
    </message>
    <message>
        <source>Simulated cameras are all exposed at the same moment.</source>
        <translation>Simulierte Kameras werden alle zum selben Zeitpunkt belichtet.</translation>
    </message>
    <message>
        <source>Another camera has the name {name}.</source>
        <translation>Eine andere Kamera heißt schon {name}.</translation>
    </message>
    <message>
        <source>Board</source>
        <translation>Tafel</translation>
    </message>
    <message>
        <source>Scale from the board&apos;s pitch</source>
        <translation>Maßstab aus dem Raster der Tafel</translation>
    </message>
    <message>
        <source>This computer&apos;s network does not say which addresses are free.</source>
        <translation>Im Netz dieses Rechners ist nicht zu erkennen, welche Adressen frei sind.</translation>
    </message>
    <message>
        <source>Give the camera an address with its maker&apos;s program.</source>
        <translation>Der Kamera mit dem Programm des Herstellers eine Adresse geben.</translation>
    </message>
</context>
<context>
    <name>ConnectPage</name>
    <message>
        <source>Cameras</source>
        <translation>Kameras</translation>
    </message>
    <message>
        <source>Choose another</source>
        <translation>Eine andere wählen</translation>
    </message>
    <message>
        <source>Search again</source>
        <translation>Erneut suchen</translation>
    </message>
    <message>
        <source>On the bench</source>
        <translation>Messmittel</translation>
    </message>
    <message>
        <source>Compare with what lies there: the targets&apos; numbers, the names and lengths on the bars.</source>
        <translation>Mit dem vergleichen, was dort liegt: Nummern der Zielmarken, Namen und Längen auf den Stäben.</translation>
    </message>
    <message>
        <source>Choose another description</source>
        <translation>Andere Beschreibung wählen</translation>
    </message>
    <message>
        <source>Describe the bench</source>
        <translation>Messmittel beschreiben</translation>
    </message>
    <message>
        <source>Ball, targets, bars with their certificates, limits.</source>
        <translation>Kugel, Zielmarken, Stäbe mit Zertifikaten, Grenzen.</translation>
    </message>
    <message>
        <source>Placements are captured already: begin a new calibration.</source>
        <translation>Es sind schon Aufstellungen aufgenommen: eine neue Kalibrierung beginnen.</translation>
    </message>
    <message>
        <source>Work is running.</source>
        <translation>Es läuft eine Arbeit.</translation>
    </message>
    <message>
        <source>Placements are captured already: begin a new calibration for another bench.</source>
        <translation>Es sind schon Aufstellungen aufgenommen: Für andere Messmittel eine neue Kalibrierung beginnen.</translation>
    </message>
    <message>
        <source>A session.json, or the folder of an earlier session.</source>
        <translation>Eine session.json oder der Ordner einer früheren Aufnahme.</translation>
    </message>
    <message>
        <source>Description of the bench</source>
        <translation>Beschreibung der Messmittel</translation>
    </message>
</context>
<context>
    <name>ConvergenceChart</name>
    <message>
        <source>iteration</source>
        <translation>Iteration</translation>
    </message>
    <message>
        <source>misfit, 1 at the start</source>
        <translation>Abweichung, am Anfang 1</translation>
    </message>
</context>
<context>
    <name>Details</name>
    <message>
        <source>Details</source>
        <translation>Einzelheiten</translation>
    </message>
</context>
<context>
    <name>DeviationChart</name>
    <message>
        <source>s</source>
        <translation>s</translation>
    </message>
</context>
<context>
    <name>Drivers</name>
    <message>
        <source>A new camera driver</source>
        <translation>Ein neuer Kameratreiber</translation>
    </message>
    <message>
        <source>May this camera driver be loaded? It was never used here before.</source>
        <translation>Darf dieser Kameratreiber geladen werden? Er wurde hier noch nie benutzt.</translation>
    </message>
    <message>
        <source>May this camera driver be loaded? Its file has changed since it was allowed.</source>
        <translation>Darf dieser Kameratreiber geladen werden? Seine Datei hat sich seit der Erlaubnis geändert.</translation>
    </message>
    <message>
        <source>Install the driver package of the cameras&apos; maker, then search again.</source>
        <translation>Das Treiberpaket des Kameraherstellers installieren, dann neu suchen.</translation>
    </message>
    <message>
        <source>Installed already? {name} must name the folder of its .cti file.</source>
        <translation>Schon installiert? {name} muss den Ordner seiner .cti-Datei nennen.</translation>
    </message>
    <message>
        <source>Install the 64-bit driver package of the cameras&apos; maker, then restart SphereCal.</source>
        <translation>Das 64-Bit-Treiberpaket des Kameraherstellers installieren, dann SphereCal neu starten.</translation>
    </message>
    <message>
        <source>Or the built-in driver, for GigE and USB3 Vision cameras of any maker: {line}</source>
        <translation>Oder der eingebaute Treiber, für GigE- und USB3-Vision-Kameras aller Hersteller: {line}</translation>
    </message>
    <message>
        <source>No camera driver is installed.</source>
        <translation>Kein Kameratreiber ist installiert.</translation>
    </message>
    <message>
        <source>The driver does not reach these cameras: {names}.</source>
        <translation>Der Treiber erreicht diese Kameras nicht: {names}.</translation>
    </message>
    <message>
        <source>The driver {name} is not allowed, so it was not loaded.</source>
        <translation>Der Treiber {name} ist nicht erlaubt und wurde nicht geladen.</translation>
    </message>
    <message>
        <source>A driver is a program. Load it only if you or its maker have installed it.</source>
        <translation>Ein Treiber ist ein Programm. Nur laden, wenn Sie oder der Hersteller ihn installiert haben.</translation>
    </message>
    <message>
        <source>The driver {name} does not work.</source>
        <translation>Der Treiber {name} funktioniert nicht.</translation>
    </message>
    <message>
        <source>Install it again with its maker&apos;s installer; never copy the file alone.</source>
        <translation>Mit dem Installationsprogramm des Herstellers neu installieren; nie nur die Datei kopieren.</translation>
    </message>
    <message>
        <source>The driver works, but sees no camera: {names}.</source>
        <translation>Der Treiber funktioniert, findet aber keine Kamera: {names}.</translation>
    </message>
    <message>
        <source>Power and cables: is the light at each camera&apos;s plug on?</source>
        <translation>Strom und Kabel: Leuchtet an jedem Kamerastecker das Licht?</translation>
    </message>
    <message>
        <source>Close the maker&apos;s own viewer and any other program that holds the cameras.</source>
        <translation>Alle Programme schließen, die Kameras benutzen, auch das des Herstellers.</translation>
    </message>
    <message>
        <source>Some drivers only see their own maker&apos;s cameras: install that of your cameras.</source>
        <translation>Manche Treiber sehen nur Kameras ihres Herstellers: den für Ihre Kameras installieren.</translation>
    </message>
    <message>
        <source>GigE: let SphereCal through the Windows firewall, in private networks too.</source>
        <translation>GigE: SphereCal in der Windows-Firewall zulassen, auch in privaten Netzen.</translation>
    </message>
    <message>
        <source>USB3: Device Manager must show the cameras with their maker&apos;s driver.</source>
        <translation>USB3: Der Geräte-Manager muss die Kameras mit dem Treiber ihres Herstellers zeigen.</translation>
    </message>
    <message>
        <source>GigE: spherecal cameras doctor examines the network line.</source>
        <translation>GigE: spherecal cameras doctor untersucht die Netzleitung.</translation>
    </message>
    <message>
        <source>USB3: replug the cameras after installing the driver (its udev rules).</source>
        <translation>USB3: Nach der Installation des Treibers die Kameras neu einstecken (udev-Regeln).</translation>
    </message>
    <message>
        <source>any maker (GigE, USB3 Vision)</source>
        <translation>jeder Hersteller (GigE, USB3 Vision)</translation>
    </message>
    <message>
        <source>as its installer says</source>
        <translation>wie sein Installer sagt</translation>
    </message>
    <message>
        <source>Load it</source>
        <translation>Laden</translation>
    </message>
    <message>
        <source>Do not load it</source>
        <translation>Nicht laden</translation>
    </message>
</context>
<context>
    <name>DriversPanel</name>
    <message>
        <source>Makers and their drivers</source>
        <translation>Hersteller und ihre Treiber</translation>
    </message>
    <message>
        <source>Allow this driver</source>
        <translation>Diesen Treiber erlauben</translation>
    </message>
    <message>
        <source>Use the built-in driver</source>
        <translation>Eingebauten Treiber verwenden</translation>
    </message>
    <message>
        <source>Do it now</source>
        <translation>Jetzt ausführen</translation>
    </message>
</context>
<context>
    <name>Effects</name>
    <message>
        <source>Every lens does what its model says.</source>
        <translation>Jedes Objektiv tut, was sein Modell sagt.</translation>
    </message>
    <message>
        <source>The lens of {camera} is farthest from its model: {px:.3f} px. It is corrected.</source>
        <translation>Das Objektiv von {camera} weicht am meisten von seinem Modell ab: {px:.3f} px. Das wird korrigiert.</translation>
    </message>
    <message>
        <source>No camera turned over the placements.</source>
        <translation>Keine Kamera hat sich über die Aufstellungen gedreht.</translation>
    </message>
    <message>
        <source>{camera} turned most over the placements: {px:.2f} px. Look at its mount and cable.</source>
        <translation>{camera} hat sich über die Aufstellungen am meisten gedreht: {px:.2f} px. Halterung und Kabel ansehen.</translation>
    </message>
</context>
<context>
    <name>Errors</name>
    <message>
        <source>Something went wrong inside the program ({kind}: {text}).</source>
        <translation>Im Programm ist etwas schiefgegangen ({kind}: {text}).</translation>
    </message>
    <message>
        <source>What was recorded is safe. Try again; if it happens again, send the log to us.</source>
        <translation>Was aufgenommen wurde, ist sicher. Noch einmal versuchen; geschieht es wieder, uns das Protokoll senden.</translation>
    </message>
    <message>
        <source>No camera was found.</source>
        <translation>Keine Kamera gefunden.</translation>
    </message>
    <message>
        <source>Plug the cameras in and switch them on; no other program may hold them.</source>
        <translation>Kameras anschließen und einschalten; kein anderes Programm darf sie benutzen.</translation>
    </message>
    <message>
        <source>No camera delivered an image of {name}.</source>
        <translation>Keine Kamera hat ein Bild von {name} geliefert.</translation>
    </message>
    <message>
        <source>Check the cameras at Connect.</source>
        <translation>Die Kameras bei „Verbinden“ prüfen.</translation>
    </message>
    <message>
        <source>Retake {name}: what is on disk is damaged.</source>
        <translation>{name} neu aufnehmen: Was auf der Platte liegt, ist beschädigt.</translation>
    </message>
</context>
<context>
    <name>FindingsList</name>
    <message>
        <source>Nothing to complain about.</source>
        <translation>Nichts zu beanstanden.</translation>
    </message>
    <message>
        <source>{title}: {where}</source>
        <translation>{title}: {where}</translation>
    </message>
    <message>
        <source>It is already requested: calibrate again.</source>
        <translation>Schon verlangt: neu kalibrieren.</translation>
    </message>
    <message>
        <source>Asked for: {repair}</source>
        <translation>Verlangt: {repair}</translation>
    </message>
    <message>
        <source>Take back</source>
        <translation>Zurücknehmen</translation>
    </message>
</context>
<context>
    <name>Footer</name>
    <message>
        <source>Back</source>
        <translation>Zurück</translation>
    </message>
    <message>
        <source>Show me</source>
        <translation>Zeigen</translation>
    </message>
    <message>
        <source>Next</source>
        <translation>Weiter</translation>
    </message>
    <message>
        <source>This is the first step.</source>
        <translation>Das ist der erste Schritt.</translation>
    </message>
</context>
<context>
    <name>Frame</name>
    <message>
        <source>{name}: the ball&apos;s centre</source>
        <translation>{name}: Mitte der Kugel</translation>
    </message>
    <message>
        <source>{name}: mark of a bar</source>
        <translation>{name}: Marke eines Stabs</translation>
    </message>
    <message>
        <source>{name}: a point</source>
        <translation>{name}: ein Punkt</translation>
    </message>
    <message>
        <source>the reference camera&apos;s frame ({camera})</source>
        <translation>Koordinatensystem der Referenzkamera ({camera})</translation>
    </message>
    <message>
        <source>the user&apos;s frame: origin {origin}, X axis to {x}, XY plane with {xy}</source>
        <translation>eigenes Koordinatensystem: Ursprung {origin}, X-Achse zu {x}, XY-Ebene mit {xy}</translation>
    </message>
    <message>
        <source>, offset {offset} mm</source>
        <translation>, Versatz {offset} mm</translation>
    </message>
    <message>
        <source>, turned {turns}</source>
        <translation>, gedreht {turns}</translation>
    </message>
    <message>
        <source>Exports are given in: {frame}.</source>
        <translation>Exporte in: {frame}.</translation>
    </message>
    <message>
        <source>{origin} lies at {x} / {y} / {z} mm; {to} is {distance} mm from it, {xy} {angle}° off.</source>
        <translation>{origin} liegt bei {x} / {y} / {z} mm; {to} ist {distance} mm davon entfernt, {xy} {angle}° daneben.</translation>
    </message>
    <message>
        <source>Uncertainty (k = 1): origin {mm} mm, axes {deg}°.</source>
        <translation>Unsicherheit (k = 1): Ursprung {mm} mm, Achsen {deg}°.</translation>
    </message>
    <message>
        <source>The frame of this project cannot be made with this calibration: {why}</source>
        <translation>Das Koordinatensystem dieses Projekts lässt sich mit dieser Kalibrierung nicht bilden: {why}</translation>
    </message>
    <message>
        <source>Choose origin and axes again.</source>
        <translation>Ursprung und Achsen neu wählen.</translation>
    </message>
    <message>
        <source>Verify again, or choose origin and axes again.</source>
        <translation>Erneut verifizieren, oder Ursprung und Achsen neu wählen.</translation>
    </message>
</context>
<context>
    <name>FrameDialog</name>
    <message>
        <source>Origin and axes</source>
        <translation>Ursprung und Achsen</translation>
    </message>
    <message>
        <source>Turn the axes by 90 degrees:</source>
        <translation>Achsen um 90 Grad drehen:</translation>
    </message>
    <message>
        <source>The origin&apos;s place lies at:</source>
        <translation>Der Ort des Ursprungs liegt bei:</translation>
    </message>
    <message>
        <source>Origin</source>
        <translation>Ursprung</translation>
    </message>
    <message>
        <source>X axis to</source>
        <translation>X-Achse zu</translation>
    </message>
    <message>
        <source>XY plane with</source>
        <translation>XY-Ebene mit</translation>
    </message>
    <message>
        <source>the reference camera</source>
        <translation>die Referenzkamera</translation>
    </message>
    <message>
        <source>Offset along {axis}, mm</source>
        <translation>Versatz entlang {axis}, mm</translation>
    </message>
    <message>
        <source>Turn the axes about {axis} by {angle} degrees</source>
        <translation>Achsen um {axis} um {angle} Grad drehen</translation>
    </message>
    <message>
        <source>Undo</source>
        <translation>Rückgängig</translation>
    </message>
    <message>
        <source>No offset, no turns</source>
        <translation>Ohne Versatz und Drehung</translation>
    </message>
    <message>
        <source>Back to the reference camera</source>
        <translation>Zurück zur Referenzkamera</translation>
    </message>
    <message>
        <source>Cancel</source>
        <translation>Abbrechen</translation>
    </message>
    <message>
        <source>OK</source>
        <translation>OK</translation>
    </message>
    <message>
        <source>Nothing was changed yet.</source>
        <translation>Es wurde noch nichts geändert.</translation>
    </message>
    <message>
        <source>It is chosen already.</source>
        <translation>Das ist schon gewählt.</translation>
    </message>
</context>
<context>
    <name>Guidance</name>
    <message>
        <source>If you stop now: being worked out</source>
        <translation>Jetzt aufhören: wird berechnet</translation>
    </message>
    <message>
        <source>If you stop now: not determined yet</source>
        <translation>Jetzt aufhören: noch nicht bestimmt</translation>
    </message>
    <message>
        <source>If you stop now: 500 ± {mm:.3f} mm</source>
        <translation>Jetzt aufhören: 500 ± {mm:.3f} mm</translation>
    </message>
    <message>
        <source>With this placement: 500 ± {mm:.3f} mm</source>
        <translation>Mit dieser Aufstellung: 500 ± {mm:.3f} mm</translation>
    </message>
    <message>
        <source>With one more placement: 500 ± {mm:.3f} mm</source>
        <translation>Mit noch einer Aufstellung: 500 ± {mm:.3f} mm</translation>
    </message>
</context>
<context>
    <name>Header</name>
    <message>
        <source>Start page</source>
        <translation>Startseite</translation>
    </message>
    <message>
        <source>Larger letters, to read from three metres.</source>
        <translation>Größere Schrift, aus drei Metern lesbar.</translation>
    </message>
    <message>
        <source>Dark</source>
        <translation>Dunkel</translation>
    </message>
    <message>
        <source>Menu</source>
        <translation>Menü</translation>
    </message>
    <message>
        <source>Light letters on a dark ground.</source>
        <translation>Helle Schrift auf dunklem Grund.</translation>
    </message>
    <message>
        <source>Large text</source>
        <translation>Große Schrift</translation>
    </message>
    <message>
        <source>Mute</source>
        <translation>Stumm</translation>
    </message>
    <message>
        <source>No sounds for accepted, rejected and done.</source>
        <translation>Keine Töne für angenommen, abgelehnt und fertig.</translation>
    </message>
    <message>
        <source>Go on by itself</source>
        <translation>Von selbst weitergehen</translation>
    </message>
    <message>
        <source>On to the next step a second after one is done and nothing is wrong.</source>
        <translation>Eine Sekunde nachdem ein Schritt fertig ist und nichts fehlt, weiter zum nächsten.</translation>
    </message>
    <message>
        <source>Log</source>
        <translation>Protokoll</translation>
    </message>
    <message>
        <source>What the program has done, line by line.</source>
        <translation>Was das Programm getan hat, Zeile für Zeile.</translation>
    </message>
    <message>
        <source>Copy as command</source>
        <translation>Als Befehl kopieren</translation>
    </message>
    <message>
        <source>Test the sound</source>
        <translation>Ton prüfen</translation>
    </message>
    <message>
        <source>Language</source>
        <translation>Sprache</translation>
    </message>
    <message>
        <source>Train on a simulated rig</source>
        <translation>Am simulierten Aufbau üben</translation>
    </message>
    <message>
        <source>a surprise</source>
        <translation>eine Überraschung</translation>
    </message>
    <message>
        <source>Help  F1</source>
        <translation>Hilfe  F1</translation>
    </message>
    <message>
        <source>Bench, bars and balls</source>
        <translation>Messmittel, Stäbe und Kugeln</translation>
    </message>
    <message>
        <source>Limits</source>
        <translation>Grenzwerte</translation>
    </message>
    <message>
        <source>Save a support bundle</source>
        <translation>Support-Paket speichern</translation>
    </message>
    <message>
        <source>About SphereCal</source>
        <translation>Über SphereCal</translation>
    </message>
</context>
<context>
    <name>Help</name>
    <message>
        <source>There is no help for this step.</source>
        <translation>Für diesen Schritt gibt es keine Hilfe.</translation>
    </message>
    <message>
        <source>Help</source>
        <translation>Hilfe</translation>
    </message>
</context>
<context>
    <name>HistogramChart</name>
    <message>
        <source>residual, px</source>
        <translation>Residuum, px</translation>
    </message>
    <message>
        <source>dots</source>
        <translation>Punkte</translation>
    </message>
</context>
<context>
    <name>Hooks</name>
    <message>
        <source>Something went wrong inside the program. What was recorded is safe.</source>
        <translation>Im Programm ist etwas schiefgegangen. Was aufgenommen wurde, ist sicher.</translation>
    </message>
    <message>
        <source>You can go on. If it happens again, send these details to us.</source>
        <translation>Die Arbeit kann weitergehen. Geschieht es wieder, uns diese Angaben senden.</translation>
    </message>
    <message>
        <source>Save a support bundle</source>
        <translation>Support-Paket speichern</translation>
    </message>
</context>
<context>
    <name>ImportDialog</name>
    <message>
        <source>Import images</source>
        <translation>Bilder importieren</translation>
    </message>
    <message>
        <source>not known</source>
        <translation>unbekannt</translation>
    </message>
    <message>
        <source>Diameter of the ball</source>
        <translation>Durchmesser der Kugel</translation>
    </message>
    <message>
        <source>They show a board, not the ball</source>
        <translation>Sie zeigen eine Tafel, nicht die Kugel</translation>
    </message>
    <message>
        <source>The images are copied. Lenses that the images do not name are assumed.</source>
        <translation>Die Bilder werden kopiert. Objektive, die sie nicht nennen, werden angenommen.</translation>
    </message>
    <message>
        <source>Cancel</source>
        <translation>Abbrechen</translation>
    </message>
    <message>
        <source>Import</source>
        <translation>Importieren</translation>
    </message>
    <message>
        <source>Folder</source>
        <translation>Ordner</translation>
    </message>
    <message>
        <source>Read as</source>
        <translation>Gelesen als</translation>
    </message>
    <message>
        <source>Cameras: {count}</source>
        <translation>Kameras: {count}</translation>
    </message>
    <message>
        <source>Placements: {count}</source>
        <translation>Aufstellungen: {count}</translation>
    </message>
    <message>
        <source>Left out: {count}</source>
        <translation>Weggelassen: {count}</translation>
    </message>
    <message>
        <source>Importing</source>
        <translation>Wird importiert</translation>
    </message>
</context>
<context>
    <name>LensBar</name>
    <message>
        <source>Focal length of all lenses</source>
        <translation>Brennweite aller Objektive</translation>
    </message>
    <message>
        <source>not known: found from the ball</source>
        <translation>unbekannt: aus der Kugel bestimmt</translation>
    </message>
    <message>
        <source>Pixel pitch</source>
        <translation>Pixelabstand</translation>
    </message>
    <message>
        <source>All lenses</source>
        <translation>Alle Objektive</translation>
    </message>
    <message>
        <source>pixels</source>
        <translation>Pixel</translation>
    </message>
    <message>
        <source>different ones</source>
        <translation>verschiedene</translation>
    </message>
    <message>
        <source>not known</source>
        <translation>unbekannt</translation>
    </message>
    <message>
        <source>On the lens. Not known: the calibration finds it from the ball.</source>
        <translation>Steht auf dem Objektiv. Unbekannt: Die Kalibrierung findet sie aus der Kugel.</translation>
    </message>
    <message>
        <source>From the camera or its data sheet; only needed with a focal length in mm.</source>
        <translation>Aus der Kamera oder ihrem Datenblatt; nur zu einer Brennweite in mm nötig.</translation>
    </message>
</context>
<context>
    <name>Limits</name>
    <message>
        <source>A calibration ages before it is out of date: give this one more.</source>
        <translation>Eine Kalibrierung altert, bevor sie veraltet ist: hier mehr angeben.</translation>
    </message>
    <message>
        <source>yes</source>
        <translation>ja</translation>
    </message>
    <message>
        <source>no</source>
        <translation>nein</translation>
    </message>
    <message>
        <source>none</source>
        <translation>keine</translation>
    </message>
    <message>
        <source>The responsible person of the rig sets these. They are kept in {path}.</source>
        <translation>Die verantwortliche Person des Messsystems stellt sie ein. Sie stehen in {path}.</translation>
    </message>
    <message>
        <source>{problem} Until then the delivered limits are used. Restore the file, or delete it to start again.</source>
        <translation>{problem} Bis dahin gelten die Grenzwerte ab Werk. Die Datei wiederherstellen oder löschen, um neu zu beginnen.</translation>
    </message>
    <message>
        <source>The rig&apos;s profile still has others; saving here gives it these.</source>
        <translation>Das Profil des Aufbaus hat noch andere; Sichern gibt ihm diese.</translation>
    </message>
    <message>
        <source>Limit changed: {line}</source>
        <translation>Grenzwert geändert: {line}</translation>
    </message>
</context>
<context>
    <name>LimitsDialog</name>
    <message>
        <source>Limits</source>
        <translation>Grenzwerte</translation>
    </message>
    <message>
        <source>Back to the delivered values</source>
        <translation>Zurück zu den Werten ab Werk</translation>
    </message>
    <message>
        <source>Save</source>
        <translation>Sichern</translation>
    </message>
    <message>
        <source>Close</source>
        <translation>Schließen</translation>
    </message>
    <message>
        <source>Nothing was changed.</source>
        <translation>Es wurde nichts geändert.</translation>
    </message>
    <message>
        <source>Close without saving</source>
        <translation>Schließen ohne Sichern</translation>
    </message>
    <message>
        <source>Saved; the new limits apply from now on.</source>
        <translation>Gesichert; die neuen Grenzwerte gelten ab jetzt.</translation>
    </message>
</context>
<context>
    <name>Log</name>
    <message>
        <source>project {folder}</source>
        <translation>Projekt {folder}</translation>
    </message>
    <message>
        <source>{step}: started</source>
        <translation>{step}: begonnen</translation>
    </message>
    <message>
        <source>{step}: ended</source>
        <translation>{step}: beendet</translation>
    </message>
    <message>
        <source>no advice for the next placement: {why}</source>
        <translation>kein Rat für die nächste Aufstellung: {why}</translation>
    </message>
    <message>
        <source>bench saved: {file}</source>
        <translation>Messmittel gespeichert: {file}</translation>
    </message>
</context>
<context>
    <name>Look</name>
    <message>
        <source>waiting for the first image</source>
        <translation>wartet auf das erste Bild</translation>
    </message>
    <message>
        <source>looking for targets</source>
        <translation>sucht Zielmarken</translation>
    </message>
    <message>
        <source>moved by {px:.0f} px, alone. Is it fixed?</source>
        <translation>allein um {px:.0f} px bewegt. Sitzt sie fest?</translation>
    </message>
    <message>
        <source>no targets in sight</source>
        <translation>keine Zielmarken in Sicht</translation>
    </message>
    <message>
        <source>no images since {time}</source>
        <translation>keine Bilder seit {time}</translation>
    </message>
    <message>
        <source>too bright: {share} % clipped. Shorten the exposure.</source>
        <translation>zu hell: {share} % übersteuert. Belichtung verkürzen.</translation>
    </message>
    <message>
        <source>{camera} is too bright.</source>
        <translation>{camera} ist zu hell.</translation>
    </message>
    <message>
        <source>{camera} is too dark.</source>
        <translation>{camera} ist zu dunkel.</translation>
    </message>
    <message>
        <source>dark. Lens cap, light, or exposure?</source>
        <translation>dunkel. Deckel, Licht oder Belichtung?</translation>
    </message>
    <message>
        <source>brightness {own} %, the others {usual} %. Open the aperture or expose longer.</source>
        <translation>Helligkeit {own} %, bei den anderen {usual} %. Blende öffnen oder länger belichten.</translation>
    </message>
    <message>
        <source>Out of focus ({blur:.1f} px). Turn the focus ring until this falls.</source>
        <translation>unscharf ({blur:.1f} px). Am Fokusring drehen, bis die Zahl fällt.</translation>
    </message>
    <message>
        <source>{camera} is out of focus.</source>
        <translation>{camera} ist unscharf.</translation>
    </message>
    <message>
        <source>All {count} cameras: sharp, dots found.</source>
        <translation>Alle {count} Kameras: scharf, Punkte gefunden.</translation>
    </message>
    <message>
        <source>Only these moved: {names}.</source>
        <translation>Nur diese wurden bewegt: {names}.</translation>
    </message>
    <message>
        <source>Only {name} moved ({px:.0f} px).</source>
        <translation>Nur {name} wurde bewegt ({px:.0f} px).</translation>
    </message>
    <message>
        <source>Tighten its mount, then press “Fixed again” at Camera check. Retake what was captured before: it no longer fits.</source>
        <translation>Halterung festziehen, dann bei „Kameraprüfung“ auf „Sitzt wieder fest“ drücken. Frühere Aufnahmen passen nicht mehr: neu aufnehmen.</translation>
    </message>
    <message>
        <source>{temperature:.0f} °C</source>
        <translation>{temperature:.0f} °C</translation>
    </message>
    <message>
        <source>{rate:.0f} fps</source>
        <translation>{rate:.0f} Bilder/s</translation>
    </message>
    <message>
        <source>{ms:g} ms</source>
        <translation>{ms:g} ms</translation>
    </message>
    <message>
        <source>not needed here</source>
        <translation>hier nicht nötig</translation>
    </message>
    <message>
        <source>sharp</source>
        <translation>scharf</translation>
    </message>
    <message>
        <source>Still warming up, in °C per minute: {rates}. Wait until it is less than 0.1: lenses move with it.</source>
        <translation>Wird noch warm, in °C je Minute: {rates}. Warten, bis es weniger als 0.1 ist: Objektive wandern dabei.</translation>
    </message>
    <message>
        <source>Check {names}.</source>
        <translation>Zu prüfen: {names}.</translation>
    </message>
    <message>
        <source>Looking for targets</source>
        <translation>Sucht Zielmarken</translation>
    </message>
    <message>
        <source>Waiting for images of {names}.</source>
        <translation>Wartet auf Bilder von {names}.</translation>
    </message>
    <message>
        <source>Could be better: {names}.</source>
        <translation>Könnte besser sein: {names}.</translation>
    </message>
    <message>
        <source>Not as wanted: {names}. Their driver took the nearest setting.</source>
        <translation>Nicht wie gewünscht: {names}. Ihr Treiber hat die nächstliegende Einstellung genommen.</translation>
    </message>
</context>
<context>
    <name>LookPage</name>
    <message>
        <source>Set exposures</source>
        <translation>Belichtung einstellen</translation>
    </message>
    <message>
        <source>Each camera gets the longest exposure by which its dots are not saturated.</source>
        <translation>Jede Kamera bekommt die längste Belichtung, bei der ihre Punkte nicht übersteuern.</translation>
    </message>
    <message>
        <source>Pixel format of all cameras</source>
        <translation>Pixelformat aller Kameras</translation>
    </message>
    <message>
        <source>different gains</source>
        <translation>verschieden</translation>
    </message>
    <message>
        <source>Gain of all cameras</source>
        <translation>Verstärkung aller Kameras</translation>
    </message>
    <message>
        <source>Mask reflections</source>
        <translation>Reflexe abdecken</translation>
    </message>
    <message>
        <source>Draw a rectangle over a reflection: nothing in it counts as a target.</source>
        <translation>Ein Rechteck über einen Reflex ziehen: Nichts darin gilt als Zielmarke.</translation>
    </message>
    <message>
        <source>Undo the last mask</source>
        <translation>Letzte Maske zurücknehmen</translation>
    </message>
    <message>
        <source>Clear all masks</source>
        <translation>Alle Masken löschen</translation>
    </message>
    <message>
        <source>Fixed again</source>
        <translation>Sitzt wieder fest</translation>
    </message>
    <message>
        <source>The cameras that were moved are fixed: they count as they stand now.</source>
        <translation>Die bewegten Kameras sitzen wieder fest: Sie gelten so, wie sie jetzt stehen.</translation>
    </message>
    <message>
        <source>Worst first</source>
        <translation>Schlechteste zuerst</translation>
    </message>
    <message>
        <source>Draw rectangles over what is no target, then press “{button}” again.</source>
        <translation>Rechtecke über alles ziehen, was keine Zielmarke ist, dann „{button}“ erneut drücken.</translation>
    </message>
    <message>
        <source>Masks: {count}</source>
        <translation>Masken: {count}</translation>
    </message>
    <message>
        <source>Work is running.</source>
        <translation>Es wird gearbeitet.</translation>
    </message>
    <message>
        <source>There are no masks.</source>
        <translation>Es gibt keine Masken.</translation>
    </message>
</context>
<context>
    <name>MakersDialog</name>
    <message>
        <source>Makers and their drivers</source>
        <translation>Hersteller und ihre Treiber</translation>
    </message>
    <message>
        <source>Install the maker&apos;s package; its driver is then found by itself. Never copy the .cti file.</source>
        <translation>Das Paket des Herstellers installieren; sein Treiber wird dann von selbst gefunden. Die .cti-Datei nie kopieren.</translation>
    </message>
    <message>
        <source>Maker</source>
        <translation>Hersteller</translation>
    </message>
    <message>
        <source>Package</source>
        <translation>Paket</translation>
    </message>
    <message>
        <source>Driver&apos;s file</source>
        <translation>Datei des Treibers</translation>
    </message>
    <message>
        <source>Usual folder</source>
        <translation>Üblicher Ordner</translation>
    </message>
    <message>
        <source>Close</source>
        <translation>Schließen</translation>
    </message>
</context>
<context>
    <name>Measure</name>
    <message>
        <source>{name}: off by {deviation}</source>
        <translation>{name}: Abweichung {deviation}</translation>
    </message>
    <message>
        <source>Choose two points for their distance, three for the angle at the second.</source>
        <translation>Zwei Punkte wählen für ihren Abstand, drei für den Winkel im zweiten.</translation>
    </message>
    <message>
        <source>Choose two or three points, not more.</source>
        <translation>Zwei oder drei Punkte wählen, nicht mehr.</translation>
    </message>
    <message>
        <source>Moved since the calibration: {cameras}. Check the rig before you measure on.</source>
        <translation>Seit der Kalibrierung bewegt: {cameras}. Vor dem Weitermessen den Aufbau prüfen.</translation>
    </message>
    <message>
        <source>No target is seen by two cameras.</source>
        <translation>Keine Zielmarke wird von zwei Kameras gesehen.</translation>
    </message>
    <message>
        <source>Target {target}: {camera} contradicts the other cameras.</source>
        <translation>Zielmarke {target}: {camera} widerspricht den anderen Kameras.</translation>
    </message>
    <message>
        <source>Target {target}: its views contradict one another.</source>
        <translation>Zielmarke {target}: Ihre Ansichten widersprechen einander.</translation>
    </message>
    <message>
        <source>The cameras agree.</source>
        <translation>Die Kameras stimmen überein.</translation>
    </message>
    <message>
        <source>{points} points</source>
        <translation>{points} Punkte</translation>
    </message>
    <message>
        <source>{rate:.1f} sets a second</source>
        <translation>{rate:.1f} Sätze je Sekunde</translation>
    </message>
    <message>
        <source>{ms:.0f} ms after the images</source>
        <translation>{ms:.0f} ms nach den Bildern</translation>
    </message>
</context>
<context>
    <name>MeasurePage</name>
    <message>
        <source>Points</source>
        <translation>Punkte</translation>
    </message>
    <message>
        <source>Points that are seen now</source>
        <translation>Punkte, die jetzt gesehen werden</translation>
    </message>
    <message>
        <source>Value</source>
        <translation>Größe</translation>
    </message>
    <message>
        <source>measured</source>
        <translation>gemessen</translation>
    </message>
    <message>
        <source>± (95 %)</source>
        <translation>± (95 %)</translation>
    </message>
    <message>
        <source>off its nominal value</source>
        <translation>Abweichung vom Sollwert</translation>
    </message>
    <message>
        <source>{sets} sets recorded in {folder}.</source>
        <translation>{sets} Sätze aufgezeichnet in {folder}.</translation>
    </message>
</context>
<context>
    <name>Placement</name>
    <message>
        <source>Ready: {names} sees little here, but enough elsewhere</source>
        <translation>Bereit: {names} sieht hier wenig, sonst aber genug</translation>
    </message>
    <message>
        <source>Ready: press space</source>
        <translation>Bereit: Leertaste drücken</translation>
    </message>
    <message>
        <source>Fewer than {needed} dots: {cameras}. Capture anyway, or move the ball</source>
        <translation>Weniger als {needed} Punkte: {cameras}. Trotzdem aufnehmen oder Kugel versetzen</translation>
    </message>
    <message>
        <source>all cameras</source>
        <translation>alle Kameras</translation>
    </message>
    <message>
        <source>Need them elsewhere in the image:</source>
        <translation>Brauchen sie anderswo im Bild:</translation>
    </message>
    <message>
        <source>At the next placements, fill other parts of the image:</source>
        <translation>Bei den nächsten Aufstellungen andere Teile des Bildes füllen:</translation>
    </message>
    <message>
        <source>Need more dots:</source>
        <translation>Brauchen mehr Punkte:</translation>
    </message>
    <message>
        <source>needs more dots</source>
        <translation>braucht mehr Punkte</translation>
    </message>
    <message>
        <source>on the left</source>
        <translation>links</translation>
    </message>
    <message>
        <source>on the right</source>
        <translation>rechts</translation>
    </message>
    <message>
        <source>at the top</source>
        <translation>oben</translation>
    </message>
    <message>
        <source>at the bottom</source>
        <translation>unten</translation>
    </message>
    <message>
        <source>no dots {part}</source>
        <translation>{part} keine Punkte</translation>
    </message>
    <message>
        <source>few dots {part}</source>
        <translation>{part} wenige Punkte</translation>
    </message>
    <message>
        <source>All cameras are linked.</source>
        <translation>Alle Kameras sind verbunden.</translation>
    </message>
    <message>
        <source>Not linked with each other: {names}</source>
        <translation>Nicht miteinander verbunden: {names}</translation>
    </message>
    <message>
        <source>{name} is captured, but without {cameras}.</source>
        <translation>{name} ist aufgenommen, aber ohne {cameras}.</translation>
    </message>
    <message>
        <source>Check these cameras, then retake it.</source>
        <translation>Diese Kameras prüfen, dann erneut aufnehmen.</translation>
    </message>
    <message>
        <source>{name} is captured, but {cameras} saw it move.</source>
        <translation>{name} ist aufgenommen, in {cameras} aber bewegt.</translation>
    </message>
    <message>
        <source>Let it come to rest, then retake it.</source>
        <translation>Zur Ruhe kommen lassen, dann erneut aufnehmen.</translation>
    </message>
    <message>
        <source>{name} is captured.</source>
        <translation>{name} ist aufgenommen.</translation>
    </message>
</context>
<context>
    <name>PlacementPage</name>
    <message>
        <source>How long it has lain still</source>
        <translation>Wie lange sie schon ruht</translation>
    </message>
    <message>
        <source>Capture by itself when still</source>
        <translation>Bei Ruhe selbst aufnehmen</translation>
    </message>
    <message>
        <source>Mask the bright spots</source>
        <translation>Helle Flecken abdecken</translation>
    </message>
    <message>
        <source>The outlined bright spots stay where they are when the ball moves: nothing in them counts.</source>
        <translation>Die umrandeten hellen Flecken bleiben, wo sie sind, wenn die Kugel bewegt wird: Was in ihnen liegt, zählt nicht.</translation>
    </message>
    <message>
        <source>Leave the bright spots</source>
        <translation>Helle Flecken lassen</translation>
    </message>
    <message>
        <source>Retake</source>
        <translation>Neu aufnehmen</translation>
    </message>
    <message>
        <source>Delete</source>
        <translation>Löschen</translation>
    </message>
    <message>
        <source>Undo</source>
        <translation>Rückgängig</translation>
    </message>
    <message>
        <source>One more placement</source>
        <translation>Noch eine Aufstellung</translation>
    </message>
    <message>
        <source>Expected error on 500 mm (95 %).</source>
        <translation>Zu erwartender Fehler auf 500 mm (95 %).</translation>
    </message>
    <message>
        <source>Enough: one more placement would not be worth it.</source>
        <translation>Genug: eine weitere Aufstellung lohnt sich nicht.</translation>
    </message>
    <message>
        <source>It was turned</source>
        <translation>Sie wurde gedreht</translation>
    </message>
    <message>
        <source>The ball is in the same place, but shows another side.</source>
        <translation>Die Kugel steht, wo sie stand, zeigt aber eine andere Seite.</translation>
    </message>
    <message>
        <source>Keep it as it is</source>
        <translation>So behalten</translation>
    </message>
    <message>
        <source>Fixed again</source>
        <translation>Wieder fest</translation>
    </message>
    <message>
        <source>Once the ball lies still where it should.</source>
        <translation>Sobald die Kugel dort ruht, wo sie soll.</translation>
    </message>
    <message>
        <source>The cameras that were moved are fixed: they count as they stand now.</source>
        <translation>Die bewegten Kameras sind wieder fest: Sie gelten so, wie sie jetzt stehen.</translation>
    </message>
    <message>
        <source>A click on a camera shows its picture.</source>
        <translation>Ein Klick auf eine Kamera zeigt ihr Bild.</translation>
    </message>
    <message>
        <source>Green: covered so far. Blue: what this placement adds.</source>
        <translation>Grün: bisher abgedeckt. Blau: was diese Aufstellung hinzufügt.</translation>
    </message>
    <message>
        <source>Coverage</source>
        <translation>Abdeckung</translation>
    </message>
    <message>
        <source>Dots that two cameras have in common, over all placements and this image.</source>
        <translation>Punkte, die zwei Kameras gemeinsam haben, mit diesem Bild.</translation>
    </message>
    <message>
        <source>Pairs</source>
        <translation>Paare</translation>
    </message>
    <message>
        <source>Put it there</source>
        <translation>Dorthin legen</translation>
    </message>
    <message>
        <source>Training: moves the simulated ball to where it should go.</source>
        <translation>Übung: legt die simulierte Kugel an den gewünschten Platz.</translation>
    </message>
    <message>
        <source>In space</source>
        <translation>Im Raum</translation>
    </message>
    <message>
        <source>Skip this placement</source>
        <translation>Auslassen</translation>
    </message>
    <message>
        <source>Undo {name}</source>
        <translation>{name} zurückholen</translation>
    </message>
    <message>
        <source>Working out where the ball should go next: {seconds:.0f} s</source>
        <translation>Berechnet, wohin die Kugel als Nächstes soll: {seconds:.0f} s</translation>
    </message>
</context>
<context>
    <name>Profile</name>
    <message>
        <source>not verified</source>
        <translation>nicht verifiziert</translation>
    </message>
</context>
<context>
    <name>ProfileDialog</name>
    <message>
        <source>The rig&apos;s profile</source>
        <translation>Profil des Aufbaus</translation>
    </message>
    <message>
        <source>Number</source>
        <translation>Nummer</translation>
    </message>
    <message>
        <source>calibrated</source>
        <translation>kalibriert</translation>
    </message>
    <message>
        <source>state</source>
        <translation>Zustand</translation>
    </message>
    <message>
        <source>verified</source>
        <translation>verifiziert</translation>
    </message>
    <message>
        <source>rms
px</source>
        <translation>RMS
px</translation>
    </message>
    <message>
        <source>in use</source>
        <translation>in Gebrauch</translation>
    </message>
    <message>
        <source>Compare with the one in use</source>
        <translation>Mit der benutzten vergleichen</translation>
    </message>
    <message>
        <source>Put this one to use</source>
        <translation>Diese in Gebrauch nehmen</translation>
    </message>
    <message>
        <source>Close</source>
        <translation>Schließen</translation>
    </message>
    <message>
        <source>Choose one that is not in use.</source>
        <translation>Eine wählen, die nicht in Gebrauch ist.</translation>
    </message>
    <message>
        <source>It was not verified, and the limits forbid its use.</source>
        <translation>Sie ist nicht verifiziert, und die Grenzwerte verbieten ihren Gebrauch.</translation>
    </message>
    <message>
        <source>Its verification failed: it cannot be put to use.</source>
        <translation>Ihre Verifizierung ist fehlgeschlagen: Sie kann nicht in Gebrauch genommen werden.</translation>
    </message>
    <message>
        <source>It is not valid: it cannot be put to use.</source>
        <translation>Sie ist nicht gültig: Sie kann nicht in Gebrauch genommen werden.</translation>
    </message>
    <message>
        <source>It is in use already.</source>
        <translation>Sie ist schon in Gebrauch.</translation>
    </message>
    <message>
        <source>It is to be used with care. Why may it be put to use?</source>
        <translation>Sie ist mit Vorsicht zu verwenden. Warum darf sie in Gebrauch genommen werden?</translation>
    </message>
    <message>
        <source>Its verification failed. Why may it be put to use?</source>
        <translation>Ihre Verifizierung ist fehlgeschlagen. Warum darf sie in Gebrauch genommen werden?</translation>
    </message>
    <message>
        <source>It was not verified. Why may it be put to use?</source>
        <translation>Sie wurde nicht verifiziert. Warum darf sie in Gebrauch genommen werden?</translation>
    </message>
    <message>
        <source>It was not put to use: a reason is needed.</source>
        <translation>Sie wurde nicht in Gebrauch genommen: Eine Begründung ist nötig.</translation>
    </message>
    <message>
        <source>Calibration {number} is in use now.</source>
        <translation>Kalibrierung {number} ist jetzt in Gebrauch.</translation>
    </message>
</context>
<context>
    <name>Rail</name>
    <message>
        <source>Steps</source>
        <translation>Schritte</translation>
    </message>
</context>
<context>
    <name>ResidualView</name>
    <message>
        <source>Residuals of {name}</source>
        <translation>Residuen von {name}</translation>
    </message>
    <message>
        <source>{px:.3f} px</source>
        <translation>{px:.3f} px</translation>
    </message>
    <message>
        <source>no residuals</source>
        <translation>keine Residuen</translation>
    </message>
    <message>
        <source>Drawn {gain:.0f} times larger; most below {usual:.3f} px</source>
        <translation>{gain:.0f}-mal vergrößert; die meisten unter {usual:.3f} px</translation>
    </message>
    <message>
        <source>; {out} left out</source>
        <translation>; {out} ausgelassen</translation>
    </message>
</context>
<context>
    <name>Results</name>
    <message>
        <source>FAILED</source>
        <translation>FEHLGESCHLAGEN</translation>
    </message>
    <message>
        <source>No camera could be placed.</source>
        <translation>Keine Kamera konnte bestimmt werden.</translation>
    </message>
    <message>
        <source>{placed} of {all} cameras placed; the images agree to {rms:.3f} px.</source>
        <translation>{placed} von {all} Kameras bestimmt; die Bilder stimmen auf {rms:.3f} px überein.</translation>
    </message>
    <message>
        <source>A length of {length:.0f} mm is measured to {mm:.3f} mm (95 %).</source>
        <translation>Eine Länge von {length:.0f} mm wird auf {mm:.3f} mm genau gemessen (95 %).</translation>
    </message>
    <message>
        <source>NOT VALID</source>
        <translation>NICHT GÜLTIG</translation>
    </message>
    <message>
        <source>With care: {what}.</source>
        <translation>Mit Vorsicht: {what}.</translation>
    </message>
    <message>
        <source>USE WITH CARE</source>
        <translation>MIT VORSICHT</translation>
    </message>
    <message>
        <source>VALID</source>
        <translation>GÜLTIG</translation>
    </message>
    <message>
        <source>the scale</source>
        <translation>der Maßstab</translation>
    </message>
    <message>
        <source>a part of the volume</source>
        <translation>ein Teil des Messvolumens</translation>
    </message>
    <message>
        <source>Since calibration {number} of {made}:</source>
        <translation>Seit Kalibrierung {number} vom {made}:</translation>
    </message>
    <message>
        <source>lengths change by up to {mm:.3f} mm</source>
        <translation>Längen ändern sich um bis zu {mm:.3f} mm</translation>
    </message>
    <message>
        <source>{cameras} moved</source>
        <translation>{cameras} bewegt</translation>
    </message>
    <message>
        <source>no camera stands out</source>
        <translation>keine Kamera fällt auf</translation>
    </message>
    <message>
        <source>Mean {mean:.3f} px, largest {most:.3f} px.</source>
        <translation>Mittel {mean:.3f} px, größtes {most:.3f} px.</translation>
    </message>
    <message>
        <source>Mean {mean:.3f} px, largest {most:.3f} px; at the ball {mean_mm:.3f} and {most_mm:.3f} mm.</source>
        <translation>Mittel {mean:.3f} px, größtes {most:.3f} px; an der Kugel {mean_mm:.3f} und {most_mm:.3f} mm.</translation>
    </message>
    <message>
        <source>Show {name}</source>
        <translation>{name} zeigen</translation>
    </message>
    <message>
        <source>Retake {name}</source>
        <translation>{name} neu aufnehmen</translation>
    </message>
    <message>
        <source>Add a placement</source>
        <translation>Aufstellung hinzufügen</translation>
    </message>
    <message>
        <source>Calibrate again</source>
        <translation>Neu kalibrieren</translation>
    </message>
    <message>
        <source>Go to the bench</source>
        <translation>Zu den Messmitteln</translation>
    </message>
    <message>
        <source>Exchange {cameras} at {place}</source>
        <translation>{cameras} bei {place} tauschen</translation>
    </message>
    <message>
        <source>Exchange {place}</source>
        <translation>{place} tauschen</translation>
    </message>
    <message>
        <source>Split {camera} from {place} on</source>
        <translation>{camera} ab {place} teilen</translation>
    </message>
    <message>
        <source>Leave out {camera} at {place}</source>
        <translation>{camera} bei {place} weglassen</translation>
    </message>
    <message>
        <source>Leave out {name}</source>
        <translation>{name} weglassen</translation>
    </message>
</context>
<context>
    <name>ResultsPage</name>
    <message>
        <source>Camera</source>
        <translation>Kamera</translation>
    </message>
    <message>
        <source>rms
px</source>
        <translation>RMS
px</translation>
    </message>
    <message>
        <source>dots</source>
        <translation>Punkte</translation>
    </message>
    <message>
        <source>left
out</source>
        <translation>weg-
gelassen</translation>
    </message>
    <message>
        <source>place ±
mm</source>
        <translation>Ort ±
mm</translation>
    </message>
    <message>
        <source>turn ±
deg</source>
        <translation>Drehung ±
Grad</translation>
    </message>
    <message>
        <source>focal
px</source>
        <translation>Brennweite
px</translation>
    </message>
    <message>
        <source>change
mm</source>
        <translation>Änderung
mm</translation>
    </message>
    <message>
        <source>What to do</source>
        <translation>Was tun</translation>
    </message>
    <message>
        <source>Cameras</source>
        <translation>Kameras</translation>
    </message>
    <message>
        <source>Residuals</source>
        <translation>Residuen</translation>
    </message>
    <message>
        <source>Which image</source>
        <translation>Welches Bild</translation>
    </message>
    <message>
        <source>Leave this image out</source>
        <translation>Dieses Bild weglassen</translation>
    </message>
    <message>
        <source>Leave the camera out</source>
        <translation>Kamera weglassen</translation>
    </message>
    <message>
        <source>not placed</source>
        <translation>nicht bestimmt</translation>
    </message>
    <message>
        <source>Lenses</source>
        <translation>Objektive</translation>
    </message>
    <message>
        <source>{camera}: all images</source>
        <translation>{camera}: alle Bilder</translation>
    </message>
    <message>
        <source>It is already requested: calibrate again.</source>
        <translation>Schon verlangt: neu kalibrieren.</translation>
    </message>
    <message>
        <source>Choose one image on the left first.</source>
        <translation>Zuerst links ein Bild wählen.</translation>
    </message>
</context>
<context>
    <name>RigTab</name>
    <message>
        <source>Placements of the ball</source>
        <translation>Aufstellungen der Kugel</translation>
    </message>
    <message>
        <source>Bars&apos; temperature (°C)</source>
        <translation>Temperatur der Stäbe (°C)</translation>
    </message>
    <message>
        <source>Read it on the day, on the bar itself; empty: not read.</source>
        <translation>Am Tag selbst am Stab ablesen; leer: nicht abgelesen.</translation>
    </message>
    <message>
        <source>Limits</source>
        <translation>Grenzen</translation>
    </message>
    <message>
        <source>Open the limits</source>
        <translation>Grenzen öffnen</translation>
    </message>
    <message>
        <source>Permitted length error: {limit} mm (L in mm).</source>
        <translation>Zulässige Abweichung: {limit} mm (L in mm).</translation>
    </message>
    <message>
        <source>No permitted length error is set: lengths are judged by their own uncertainty.</source>
        <translation>Keine zulässige Abweichung ist gesetzt: Längen werden nach ihrer eigenen Unsicherheit beurteilt.</translation>
    </message>
</context>
<context>
    <name>Save</name>
    <message>
        <source>The report is in {what}.</source>
        <translation>Der Bericht ist in {what}.</translation>
    </message>
    <message>
        <source>SIMULATED: no calibration of a real rig</source>
        <translation>SIMULIERT: keine Kalibrierung eines echten Aufbaus</translation>
    </message>
    <message>
        <source>The calibration in use was not changed. This one stays in {folder}.</source>
        <translation>Die Kalibrierung in Gebrauch blieb, wie sie ist. Diese bleibt in {folder}.</translation>
    </message>
    <message>
        <source>Saved in the rig&apos;s profile as calibration {what}.</source>
        <translation>Im Profil des Aufbaus als Kalibrierung {what} gesichert.</translation>
    </message>
    <message>
        <source>Written to {what}.</source>
        <translation>Geschrieben nach {what}.</translation>
    </message>
</context>
<context>
    <name>SavePage</name>
    <message>
        <source>The rig&apos;s profile</source>
        <translation>Profil des Aufbaus</translation>
    </message>
    <message>
        <source>Keeps every calibration of this rig; the one in use changes only when you say so.</source>
        <translation>Bewahrt jede Kalibrierung dieses Aufbaus; die benutzte wechselt nur auf Wunsch.</translation>
    </message>
    <message>
        <source>Put it to use now</source>
        <translation>Jetzt in Gebrauch nehmen</translation>
    </message>
    <message>
        <source>Save in the profile</source>
        <translation>Im Profil sichern</translation>
    </message>
    <message>
        <source>Note: by whom, and why</source>
        <translation>Notiz: von wem und warum</translation>
    </message>
    <message>
        <source>Discard</source>
        <translation>Verwerfen</translation>
    </message>
    <message>
        <source>The calibration in use stays as it is; this one stays in its folder, and nothing is deleted.</source>
        <translation>Die benutzte bleibt, wie sie ist; diese bleibt in ihrem Ordner, nichts wird gelöscht.</translation>
    </message>
    <message>
        <source>Its verification failed: it cannot be put to use. Find the cause, or save it without.</source>
        <translation>Verifizierung fehlgeschlagen: nicht in Gebrauch zu nehmen. Die Ursache suchen oder nur sichern.</translation>
    </message>
    <message>
        <source>It was not verified, and the limits forbid its use: verify it, or save it without.</source>
        <translation>Nicht verifiziert, und die Grenzwerte verbieten den Gebrauch: verifizieren oder nur sichern.</translation>
    </message>
    <message>
        <source>Its verification failed: write in the note why it is put to use all the same.</source>
        <translation>Verifizierung fehlgeschlagen: In der Notiz angeben, warum sie trotzdem in Gebrauch genommen wird.</translation>
    </message>
    <message>
        <source>Its verification decided nothing: write in the note why it is put to use.</source>
        <translation>Ihre Verifizierung hat nichts entschieden: In der Notiz angeben, warum sie in Gebrauch genommen wird.</translation>
    </message>
    <message>
        <source>It was not verified: write in the note why it is put to use.</source>
        <translation>Sie ist nicht verifiziert: In der Notiz angeben, warum sie in Gebrauch genommen wird.</translation>
    </message>
    <message>
        <source>It is to be used with care: write in the note why it is put to use.</source>
        <translation>Sie ist mit Vorsicht zu benutzen: In der Notiz angeben, warum sie in Gebrauch genommen wird.</translation>
    </message>
    <message>
        <source>Its verification failed: it cannot be exported.</source>
        <translation>Ihre Verifizierung ist fehlgeschlagen: Sie kann nicht exportiert werden.</translation>
    </message>
    <message>
        <source>There is no calibration yet.</source>
        <translation>Es gibt noch keine Kalibrierung.</translation>
    </message>
    <message>
        <source>Files</source>
        <translation>Dateien</translation>
    </message>
    <message>
        <source>Open the folder</source>
        <translation>Ordner öffnen</translation>
    </message>
    <message>
        <source>Open the report</source>
        <translation>Bericht öffnen</translation>
    </message>
    <message>
        <source>Format of the export</source>
        <translation>Format des Exports</translation>
    </message>
    <message>
        <source>Export</source>
        <translation>Exportieren</translation>
    </message>
    <message>
        <source>For another program:</source>
        <translation>Für ein anderes Programm:</translation>
    </message>
    <message>
        <source>Origin and axes</source>
        <translation>Ursprung und Achsen</translation>
    </message>
    <message>
        <source>The same on the command line</source>
        <translation>Dasselbe auf der Befehlszeile</translation>
    </message>
    <message>
        <source>Copy as command</source>
        <translation>Als Befehl kopieren</translation>
    </message>
    <message>
        <source>A simulated rig has a profile of its own: it never counts as the calibration of a real one.</source>
        <translation>Ein simulierter Aufbau hat ein eigenes Profil: Er gilt nie als Kalibrierung eines wirklichen.</translation>
    </message>
    <message>
        <source>Exports are given in: {frame}.</source>
        <translation>Exporte in: {frame}.</translation>
    </message>
    <message>
        <source>Work is running.</source>
        <translation>Es wird gearbeitet.</translation>
    </message>
    <message>
        <source>The calibration is out of date.</source>
        <translation>Die Kalibrierung ist veraltet.</translation>
    </message>
    <message>
        <source>The calibration is not valid: it cannot be put to use. Save it without.</source>
        <translation>Die Kalibrierung ist nicht gültig: Sie kann nicht in Gebrauch genommen werden. Nur sichern.</translation>
    </message>
    <message>
        <source>It is not written yet.</source>
        <translation>Noch nicht geschrieben.</translation>
    </message>
    <message>
        <source>In use: calibration {number}, in {folder}.</source>
        <translation>In Gebrauch: Kalibrierung {number}, in {folder}.</translation>
    </message>
    <message>
        <source>Report: {path}</source>
        <translation>Bericht: {path}</translation>
    </message>
    <message>
        <source>No program was found here that opens it: copy the file, or open it elsewhere.</source>
        <translation>Hier wurde kein Programm gefunden, das ihn öffnet: Datei kopieren oder anderswo öffnen.</translation>
    </message>
    <message>
        <source>Copied.</source>
        <translation>Kopiert.</translation>
    </message>
</context>
<context>
    <name>ScalePage</name>
    <message>
        <source>Retake the last pose</source>
        <translation>Letzte Lage neu aufnehmen</translation>
    </message>
    <message>
        <source>Capture by itself when still</source>
        <translation>Bei Ruhe selbst aufnehmen</translation>
    </message>
    <message>
        <source>Once the bar was moved and lies still where three cameras see it.</source>
        <translation>Sobald der Stab bewegt wurde und ruht, wo drei Kameras ihn sehen.</translation>
    </message>
    <message>
        <source>No pose is captured yet.</source>
        <translation>Noch keine Lage aufgenommen.</translation>
    </message>
</context>
<context>
    <name>Scene</name>
    <message>
        <source>{length:.0f} mm at this place</source>
        <translation>{length:.0f} mm an dieser Stelle</translation>
    </message>
    <message>
        <source>{placement}, target {target}, dot {dot}</source>
        <translation>{placement}, Zielmarke {target}, Punkt {dot}</translation>
    </message>
    <message>
        <source>Serial number {serial}</source>
        <translation>Seriennummer {serial}</translation>
    </message>
    <message>
        <source>Sensor {width} × {height} px</source>
        <translation>Sensor {width} × {height} px</translation>
    </message>
    <message>
        <source>Residuals {rms:.3f} px rms</source>
        <translation>Residuen {rms:.3f} px RMS</translation>
    </message>
    <message>
        <source>Place ± {sd:.3f} mm</source>
        <translation>Ort ± {sd:.3f} mm</translation>
    </message>
    <message>
        <source>Moved by {mm:.3f} mm and {deg:.3f}°</source>
        <translation>Verschoben um {mm:.3f} mm, gedreht um {deg:.3f}°</translation>
    </message>
    <message>
        <source>Ball, radius {radius:.2f} mm</source>
        <translation>Kugel, Radius {radius:.2f} mm</translation>
    </message>
    <message>
        <source>Length error {error:+.3f} mm</source>
        <translation>Längenabweichung {error:+.3f} mm</translation>
    </message>
    <message>
        <source>Uncertainty {u:.3f} mm (95 %)</source>
        <translation>Unsicherheit {u:.3f} mm (95 %)</translation>
    </message>
    <message>
        <source>Residual {px:.3f} px rms</source>
        <translation>Residuum {px:.3f} px RMS</translation>
    </message>
    <message>
        <source>Ellipsoids: 1 σ × {factor}</source>
        <translation>Ellipsoide: 1 σ × {factor}</translation>
    </message>
    <message>
        <source>Yellow: before, way × {factor}</source>
        <translation>Gelb: vorher, Weg × {factor}</translation>
    </message>
    <message>
        <source>Bars: green within their uncertainty, red beyond</source>
        <translation>Stäbe: grün innerhalb, rot außerhalb ihrer Unsicherheit</translation>
    </message>
    <message>
        <source>Uncertainty of {length:.0f} mm, mm (95 %)</source>
        <translation>Unsicherheit von {length:.0f} mm, mm (95 %)</translation>
    </message>
    <message>
        <source>Residuals of the dots, px</source>
        <translation>Residuen der Punkte, px</translation>
    </message>
</context>
<context>
    <name>ScenePanel</name>
    <message>
        <source>Show</source>
        <translation>Zeigen</translation>
    </message>
    <message>
        <source>Dots by their residuals</source>
        <translation>Punkte nach ihren Residuen</translation>
    </message>
    <message>
        <source>Images of the cameras</source>
        <translation>Bilder der Kameras</translation>
    </message>
    <message>
        <source>Uncertainty of a length</source>
        <translation>Unsicherheit einer Länge</translation>
    </message>
    <message>
        <source>Ellipsoids of uncertainty</source>
        <translation>Unsicherheitsellipsoide</translation>
    </message>
    <message>
        <source>Paths</source>
        <translation>Pfade</translation>
    </message>
    <message>
        <source>Show all</source>
        <translation>Alles zeigen</translation>
    </message>
    <message>
        <source>Save</source>
        <translation>Speichern</translation>
    </message>
    <message>
        <source>As a picture (PNG)</source>
        <translation>Als Bild (PNG)</translation>
    </message>
    <message>
        <source>As a 3-D model (glTF)</source>
        <translation>Als 3-D-Modell (glTF)</translation>
    </message>
    <message>
        <source>Save the picture</source>
        <translation>Bild speichern</translation>
    </message>
    <message>
        <source>Save the 3-D model</source>
        <translation>3-D-Modell speichern</translation>
    </message>
    <message>
        <source>{path} could not be written.</source>
        <translation>{path} konnte nicht geschrieben werden.</translation>
    </message>
    <message>
        <source>Saved: {path}</source>
        <translation>Gespeichert: {path}</translation>
    </message>
</context>
<context>
    <name>SceneView</name>
    <message>
        <source>The rig with its cameras {names}</source>
        <translation>Der Aufbau mit den Kameras {names}</translation>
    </message>
</context>
<context>
    <name>Sounds</name>
    <message>
        <source>There is no program that plays sounds; one of these is needed: {names}.</source>
        <translation>Es fehlt ein Programm, das Töne abspielt; nötig ist eines von: {names}.</translation>
    </message>
    <message>
        <source>The sound device does not work: {why}. Choose one in the system&apos;s settings.</source>
        <translation>Die Tonausgabe arbeitet nicht: {why}. In den Einstellungen des Systems eine wählen.</translation>
    </message>
</context>
<context>
    <name>Source</name>
    <message>
        <source>SIMULATED</source>
        <translation>SIMULIERT</translation>
    </message>
    <message>
        <source>REPLAY</source>
        <translation>WIEDERGABE</translation>
    </message>
    <message>
        <source>LIVE</source>
        <translation>LIVE</translation>
    </message>
</context>
<context>
    <name>Start</name>
    <message>
        <source>verified</source>
        <translation>verifiziert</translation>
    </message>
    <message>
        <source>the check bar contradicts it</source>
        <translation>der Prüfstab widerspricht</translation>
    </message>
    <message>
        <source>calibrated, not valid</source>
        <translation>kalibriert, nicht gültig</translation>
    </message>
    <message>
        <source>calibrated, not verified</source>
        <translation>kalibriert, nicht verifiziert</translation>
    </message>
    <message>
        <source>{taken} of {planned} placements captured</source>
        <translation>{taken} von {planned} Aufstellungen aufgenommen</translation>
    </message>
    <message>
        <source>verified, undecided</source>
        <translation>verifiziert, unentschieden</translation>
    </message>
    <message>
        <source>check begun</source>
        <translation>Prüfung begonnen</translation>
    </message>
    <message>
        <source>checked: {verdict}</source>
        <translation>geprüft: {verdict}</translation>
    </message>
    <message>
        <source>Check the rig again by {at}.</source>
        <translation>Aufbau wieder prüfen bis {at}.</translation>
    </message>
    <message>
        <source>Calibration {number}, verified {at}: {verdict}</source>
        <translation>Kalibrierung {number}, verifiziert {at}: {verdict}</translation>
    </message>
    <message>
        <source>Calibration {number}, not verified yet</source>
        <translation>Kalibrierung {number}, noch nicht verifiziert</translation>
    </message>
    <message>
        <source>Calibration {number}: {verdict}</source>
        <translation>Kalibrierung {number}: {verdict}</translation>
    </message>
    <message>
        <source>Calibrated {minutes} minutes ago</source>
        <translation>Vor {minutes} Minuten kalibriert</translation>
    </message>
    <message>
        <source>Calibrated {hours} hours ago</source>
        <translation>Vor {hours} Stunden kalibriert</translation>
    </message>
    <message>
        <source>Calibrated {days} days ago</source>
        <translation>Vor {days} Tagen kalibriert</translation>
    </message>
</context>
<context>
    <name>StartPage</name>
    <message>
        <source>Open another folder</source>
        <translation>Anderen Ordner öffnen</translation>
    </message>
    <message>
        <source>Check</source>
        <translation>Prüfen</translation>
    </message>
    <message>
        <source>no calibration in use</source>
        <translation>keine Kalibrierung in Gebrauch</translation>
    </message>
    <message>
        <source>The rig&apos;s profile</source>
        <translation>Profil des Aufbaus</translation>
    </message>
    <message>
        <source>Rig in use</source>
        <translation>Aufbau in Gebrauch</translation>
    </message>
    <message>
        <source>Check the rig</source>
        <translation>Aufbau prüfen</translation>
    </message>
    <message>
        <source>Calibrate</source>
        <translation>Kalibrieren</translation>
    </message>
    <message>
        <source>A new calibration of the whole rig, from the cameras to the report.</source>
        <translation>Eine neue Kalibrierung des ganzen Aufbaus, von den Kameras bis zum Bericht.</translation>
    </message>
    <message>
        <source>Recent</source>
        <translation>Zuletzt</translation>
    </message>
    <message>
        <source>Replay a recorded session</source>
        <translation>Aufnahme wiedergeben</translation>
    </message>
    <message>
        <source>Calibrate the rig</source>
        <translation>Aufbau kalibrieren</translation>
    </message>
    <message>
        <source>Verify</source>
        <translation>Verifizieren</translation>
    </message>
    <message>
        <source>Bench, bars and balls</source>
        <translation>Messmittel, Stäbe und Kugeln</translation>
    </message>
    <message>
        <source>Verify the rig</source>
        <translation>Aufbau verifizieren</translation>
    </message>
    <message>
        <source>Has a camera moved since? One minute, one placement of the ball.</source>
        <translation>Hat sich seither eine Kamera bewegt? Eine Minute, eine Aufstellung der Kugel.</translation>
    </message>
    <message>
        <source>Does the rig measure right? The check bar is measured, and the result printed.</source>
        <translation>Misst der Aufbau richtig? Der Prüfstab wird gemessen, das Ergebnis gedruckt.</translation>
    </message>
    <message>
        <source>Train on a simulated rig</source>
        <translation>Am simulierten Aufbau üben</translation>
    </message>
    <message>
        <source>Nothing yet. Projects are kept in {folder}.</source>
        <translation>Noch nichts. Projekte liegen in {folder}.</translation>
    </message>
    <message>
        <source>Save a calibration in the rig&apos;s profile; then it can be checked.</source>
        <translation>Eine Kalibrierung im Profil sichern; dann kann sie geprüft werden.</translation>
    </message>
    <message>
        <source>No calibration is in use yet: calibrate, then save it in the rig&apos;s profile.</source>
        <translation>Noch keine Kalibrierung in Gebrauch: kalibrieren, dann im Profil des Aufbaus sichern.</translation>
    </message>
    <message>
        <source>Open a project</source>
        <translation>Projekt öffnen</translation>
    </message>
    <message>
        <source>A recorded session with images</source>
        <translation>Eine Aufnahme mit Bildern</translation>
    </message>
    <message>
        <source>No calibration was saved in the rig&apos;s profile yet.</source>
        <translation>Im Profil des Aufbaus ist noch keine Kalibrierung gesichert.</translation>
    </message>
    <message>
        <source>Calibrate with a board</source>
        <translation>Mit einer Tafel kalibrieren</translation>
    </message>
    <message>
        <source>ChArUco, AprilGrid, chessboard or circles; no ball is needed.</source>
        <translation>ChArUco, AprilGrid, Schachbrett oder Kreise; es braucht keine Kugel.</translation>
    </message>
</context>
<context>
    <name>State</name>
    <message>
        <source>Work is running.</source>
        <translation>Es wird gearbeitet.</translation>
    </message>
    <message>
        <source>The cameras are not connected.</source>
        <translation>Die Kameras sind nicht verbunden.</translation>
    </message>
    <message>
        <source>The cameras are being looked for.</source>
        <translation>Die Kameras werden gesucht.</translation>
    </message>
    <message>
        <source>There are no cameras yet.</source>
        <translation>Es gibt noch keine Kameras.</translation>
    </message>
    <message>
        <source>It was confirmed already.</source>
        <translation>Schon bestätigt.</translation>
    </message>
    <message>
        <source>Bench confirmed</source>
        <translation>Messmittel bestätigt</translation>
    </message>
    <message>
        <source>Yes, this matches</source>
        <translation>Ja, das stimmt</translation>
    </message>
    <message>
        <source>{cameras}. What is on the bench?</source>
        <translation>{cameras}. Welche Messmittel sind da?</translation>
    </message>
    <message>
        <source>Describe the bench</source>
        <translation>Messmittel beschreiben</translation>
    </message>
    <message>
        <source>{cameras}. Is this on the bench?</source>
        <translation>{cameras}. Stimmen die Messmittel?</translation>
    </message>
    <message>
        <source>The images are good</source>
        <translation>Die Bilder sind gut</translation>
    </message>
    <message>
        <source>Use the images as they are</source>
        <translation>Bilder so verwenden, wie sie sind</translation>
    </message>
    <message>
        <source>They were accepted already.</source>
        <translation>Schon angenommen.</translation>
    </message>
    <message>
        <source>See to the cameras that are named above.</source>
        <translation>Die oben genannten Kameras prüfen.</translation>
    </message>
    <message>
        <source>Targets are being looked for. On a new computer the first time takes a minute or two.</source>
        <translation>Zielmarken werden gesucht. Auf einem neuen Rechner dauert das erste Mal ein bis zwei Minuten.</translation>
    </message>
    <message>
        <source>Not every camera has sent an image yet.</source>
        <translation>Noch hat nicht jede Kamera ein Bild geschickt.</translation>
    </message>
    <message>
        <source>Next, once this is captured.</source>
        <translation>Weiter, sobald aufgenommen ist.</translation>
    </message>
    <message>
        <source>Next, once this is captured or skipped.</source>
        <translation>Weiter, sobald aufgenommen oder übersprungen ist.</translation>
    </message>
    <message>
        <source>Capture  (space)</source>
        <translation>Aufnehmen  (Leertaste)</translation>
    </message>
    <message>
        <source>Capture without {cameras}</source>
        <translation>Ohne {cameras} aufnehmen</translation>
    </message>
    <message>
        <source>Capture anyway  (space)</source>
        <translation>Trotzdem aufnehmen  (Leertaste)</translation>
    </message>
    <message>
        <source>Capturing</source>
        <translation>Nimmt auf</translation>
    </message>
    <message>
        <source>Retake  (space)</source>
        <translation>Neu aufnehmen  (Leertaste)</translation>
    </message>
    <message>
        <source>Go on without {cameras}</source>
        <translation>Ohne {cameras} weiter</translation>
    </message>
    <message>
        <source>Captured</source>
        <translation>Aufgenommen</translation>
    </message>
    <message>
        <source>Images are being captured.</source>
        <translation>Es wird aufgenommen.</translation>
    </message>
    <message>
        <source>The dots are being found in the images; the ball may be moved already.</source>
        <translation>Die Punkte in den Bildern werden gesucht; die Kugel darf schon bewegt werden.</translation>
    </message>
    <message>
        <source>Turn or move the ball: {names} sees too little</source>
        <translation>Kugel drehen oder versetzen: {names} sieht zu wenig</translation>
    </message>
    <message>
        <source>Hold still: images are being captured</source>
        <translation>Stillhalten: Es wird aufgenommen</translation>
    </message>
    <message>
        <source>The images are there; their dots are being found</source>
        <translation>Die Bilder sind da; ihre Punkte werden gesucht</translation>
    </message>
    <message>
        <source>Retake it, or keep it as it is</source>
        <translation>Neu aufnehmen oder so behalten</translation>
    </message>
    <message>
        <source>Captured. Press space to go on</source>
        <translation>Aufgenommen. Leertaste: weiter</translation>
    </message>
    <message>
        <source>The recording shows no targets here</source>
        <translation>Die Aufzeichnung zeigt hier keine Zielmarken</translation>
    </message>
    <message>
        <source>Recorded images. Press space to take them over</source>
        <translation>Aufgezeichnete Bilder. Leertaste: übernehmen</translation>
    </message>
    <message>
        <source>Put the ball where the cameras see it</source>
        <translation>Die Kugel dorthin stellen, wo die Kameras sie sehen</translation>
    </message>
    <message>
        <source>Move the ball, or confirm that it was turned</source>
        <translation>Kugel bewegen, oder bestätigen, dass sie gedreht wurde</translation>
    </message>
    <message>
        <source>Checking that the ball is still</source>
        <translation>Prüft, ob die Kugel ruht</translation>
    </message>
    <message>
        <source>Let the ball come to rest</source>
        <translation>Die Kugel zur Ruhe kommen lassen</translation>
    </message>
    <message>
        <source>Move the board: elsewhere, and tilted otherwise</source>
        <translation>Die Tafel bewegen: an eine andere Stelle, anders geneigt</translation>
    </message>
    <message>
        <source>Show the board to the cameras</source>
        <translation>Die Tafel den Kameras zeigen</translation>
    </message>
    <message>
        <source>Checking that the board is still</source>
        <translation>Prüft, ob die Tafel ruht</translation>
    </message>
    <message>
        <source>Hold the board still</source>
        <translation>Die Tafel ruhig halten</translation>
    </message>
    <message>
        <source>Leave the ball where it is</source>
        <translation>Kugel stehen lassen</translation>
    </message>
    <message>
        <source>Move the ball {up:.0f} mm down</source>
        <translation>Kugel {up:.0f} mm tiefer stellen</translation>
    </message>
    <message>
        <source>Move the ball {up:.0f} mm up</source>
        <translation>Kugel {up:.0f} mm höher stellen</translation>
    </message>
    <message>
        <source>Move the ball {away:.0f} mm towards {camera}</source>
        <translation>Kugel {away:.0f} mm Richtung {camera} stellen</translation>
    </message>
    <message>
        <source>Move the ball {away:.0f} mm towards {camera} and {up:.0f} mm up</source>
        <translation>Kugel {away:.0f} mm Richtung {camera} und {up:.0f} mm höher</translation>
    </message>
    <message>
        <source>Move the ball {away:.0f} mm towards {camera} and {up:.0f} mm down</source>
        <translation>Kugel {away:.0f} mm Richtung {camera} und {up:.0f} mm tiefer</translation>
    </message>
    <message>
        <source>tip its top {turn:.0f}° towards {camera}</source>
        <translation>oben um {turn:.0f}° auf {camera} zu kippen</translation>
    </message>
    <message>
        <source>turn it {turn:.0f}° to the left, as on a turntable</source>
        <translation>{turn:.0f}° nach links drehen wie einen Drehteller</translation>
    </message>
    <message>
        <source>turn it {turn:.0f}° to the right, as on a turntable</source>
        <translation>{turn:.0f}° nach rechts drehen wie einen Drehteller</translation>
    </message>
    <message>
        <source>{place}, {turn}</source>
        <translation>{place}, {turn}</translation>
    </message>
    <message>
        <source>All poses are captured</source>
        <translation>Alle Lagen sind aufgenommen</translation>
    </message>
    <message>
        <source>The recording shows no bar here</source>
        <translation>Die Aufzeichnung zeigt hier keinen Stab</translation>
    </message>
    <message>
        <source>Lay the bar where two cameras or more see it</source>
        <translation>Den Stab so legen, dass mindestens zwei Kameras ihn sehen</translation>
    </message>
    <message>
        <source>Only two cameras see the bar; three are better</source>
        <translation>Nur zwei Kameras sehen den Stab; drei sind besser</translation>
    </message>
    <message>
        <source>Ready: press space</source>
        <translation>Bereit: Leertaste drücken</translation>
    </message>
    <message>
        <source>All poses captured</source>
        <translation>Alle Lagen aufgenommen</translation>
    </message>
    <message>
        <source>Measure the bar</source>
        <translation>Stab messen</translation>
    </message>
    <message>
        <source>Measuring</source>
        <translation>Misst</translation>
    </message>
    <message>
        <source>Lengths are being measured.</source>
        <translation>Längen werden gemessen.</translation>
    </message>
    <message>
        <source>It is measured; retake a pose to measure again.</source>
        <translation>Gemessen; eine Lage neu aufnehmen, um erneut zu messen.</translation>
    </message>
    <message>
        <source>Calibrate</source>
        <translation>Kalibrieren</translation>
    </message>
    <message>
        <source>The last stage is coming to its end.</source>
        <translation>Der letzte Schritt kommt zum Ende.</translation>
    </message>
    <message>
        <source>Stopping</source>
        <translation>Hält an</translation>
    </message>
    <message>
        <source>Stopping: what was captured is kept</source>
        <translation>Hält an: Die Aufnahmen bleiben erhalten</translation>
    </message>
    <message>
        <source>Computing</source>
        <translation>Rechnet</translation>
    </message>
    <message>
        <source>Stopping as soon as there is a result</source>
        <translation>Hört auf, sobald es ein Ergebnis gibt</translation>
    </message>
    <message>
        <source>Cancel</source>
        <translation>Abbrechen</translation>
    </message>
    <message>
        <source>Ready: {taken} of {planned} placements</source>
        <translation>Bereit: {taken} von {planned} Aufstellungen</translation>
    </message>
    <message>
        <source>It failed; what was captured is kept</source>
        <translation>Fehlgeschlagen; die Aufnahmen bleiben erhalten</translation>
    </message>
    <message>
        <source>Done: the calibration is valid</source>
        <translation>Fertig: Die Kalibrierung ist gültig</translation>
    </message>
    <message>
        <source>Done: the calibration is to be used with care</source>
        <translation>Fertig: Die Kalibrierung ist mit Vorsicht zu benutzen</translation>
    </message>
    <message>
        <source>See what to do</source>
        <translation>Anzeigen, was zu tun ist</translation>
    </message>
    <message>
        <source>Done: the calibration is not valid</source>
        <translation>Fertig: Die Kalibrierung ist nicht gültig</translation>
    </message>
    <message>
        <source>Accept the result</source>
        <translation>Ergebnis annehmen</translation>
    </message>
    <message>
        <source>Reading the result</source>
        <translation>Ergebnis wird gelesen</translation>
    </message>
    <message>
        <source>The result is being read.</source>
        <translation>Das Ergebnis wird gelesen.</translation>
    </message>
    <message>
        <source>A calibration is running: wait for what comes of it.</source>
        <translation>Eine Kalibrierung läuft: ihr Ergebnis abwarten.</translation>
    </message>
    <message>
        <source>Being computed again</source>
        <translation>Wird neu berechnet</translation>
    </message>
    <message>
        <source>Calibrate again</source>
        <translation>Neu kalibrieren</translation>
    </message>
    <message>
        <source>OUT OF DATE</source>
        <translation>VERALTET</translation>
    </message>
    <message>
        <source>It was accepted already.</source>
        <translation>Schon angenommen.</translation>
    </message>
    <message>
        <source>It is not valid: do what the findings advise.</source>
        <translation>Nicht gültig: tun, was die Befunde raten.</translation>
    </message>
    <message>
        <source>It was asked to stop.</source>
        <translation>Das Anhalten ist verlangt.</translation>
    </message>
    <message>
        <source>Write the report</source>
        <translation>Bericht schreiben</translation>
    </message>
    <message>
        <source>See what has changed</source>
        <translation>Zeigen, was sich geändert hat</translation>
    </message>
    <message>
        <source>Save and put to use</source>
        <translation>Sichern und in Gebrauch nehmen</translation>
    </message>
    <message>
        <source>Save in the profile</source>
        <translation>Im Profil sichern</translation>
    </message>
    <message>
        <source>Finish</source>
        <translation>Fertig</translation>
    </message>
    <message>
        <source>Writing</source>
        <translation>Schreibt</translation>
    </message>
    <message>
        <source>The calibration is not saved yet</source>
        <translation>Die Kalibrierung ist noch nicht gesichert</translation>
    </message>
    <message>
        <source>What was saved is out of date</source>
        <translation>Was gesichert wurde, ist veraltet</translation>
    </message>
    <message>
        <source>Not saved yet; its verification failed</source>
        <translation>Noch nicht gesichert; Verifizierung fehlgeschlagen</translation>
    </message>
    <message>
        <source>Not saved yet</source>
        <translation>Noch nicht gesichert</translation>
    </message>
    <message>
        <source>Not saved yet; its verification decided nothing</source>
        <translation>Noch nicht gesichert; Verifizierung unentschieden</translation>
    </message>
    <message>
        <source>Not saved yet; not verified</source>
        <translation>Noch nicht gesichert; nicht verifiziert</translation>
    </message>
    <message>
        <source>Saved; it is not valid</source>
        <translation>Gesichert; sie ist nicht gültig</translation>
    </message>
    <message>
        <source>Saved; its verification failed</source>
        <translation>Gesichert; Verifizierung fehlgeschlagen</translation>
    </message>
    <message>
        <source>Saved; its verification decided nothing</source>
        <translation>Gesichert; Verifizierung unentschieden</translation>
    </message>
    <message>
        <source>Saved; not verified</source>
        <translation>Gesichert; nicht verifiziert</translation>
    </message>
    <message>
        <source>Saved; to be used with care</source>
        <translation>Gesichert; mit Vorsicht zu benutzen</translation>
    </message>
    <message>
        <source>Saved</source>
        <translation>Gesichert</translation>
    </message>
    <message>
        <source>Checking</source>
        <translation>Prüfung läuft</translation>
    </message>
    <message>
        <source>Check</source>
        <translation>Prüfen</translation>
    </message>
    <message>
        <source>Not done</source>
        <translation>Nicht erledigt</translation>
    </message>
    <message>
        <source>Check again</source>
        <translation>Erneut prüfen</translation>
    </message>
    <message>
        <source>Put the repair to use</source>
        <translation>Reparatur in Gebrauch nehmen</translation>
    </message>
    <message>
        <source>Ready</source>
        <translation>Bereit</translation>
    </message>
    <message>
        <source>Recording: {sets} sets</source>
        <translation>Aufzeichnung: {sets} Sätze</translation>
    </message>
    <message>
        <source>Stop recording</source>
        <translation>Aufzeichnung beenden</translation>
    </message>
    <message>
        <source>Nothing is measured now.</source>
        <translation>Im Moment wird nichts gemessen.</translation>
    </message>
    <message>
        <source>Record</source>
        <translation>Aufzeichnen</translation>
    </message>
    <message>
        <source>{seconds:.0f} s, longer than usual ({usual:.0f} s)</source>
        <translation>{seconds:.0f} s, länger als sonst ({usual:.0f} s)</translation>
    </message>
    <message>
        <source>{seconds:.0f} s</source>
        <translation>{seconds:.0f} s</translation>
    </message>
    <message>
        <source>{gone}, nearly done</source>
        <translation>{gone}, fast fertig</translation>
    </message>
    <message>
        <source>{gone}, about {left} s left</source>
        <translation>{gone}, noch etwa {left} s</translation>
    </message>
    <message>
        <source>{gone}, about {left} min left</source>
        <translation>{gone}, noch etwa {left} min</translation>
    </message>
</context>
<context>
    <name>Tile</name>
    <message>
        <source>{name}, serial {serial}, exposure {ms:g} ms. Double click to enlarge, again to go back.</source>
        <translation>{name}, Seriennummer {serial}, Belichtung {ms:g} ms. Doppelklick vergrößert, ein weiterer verkleinert.</translation>
    </message>
</context>
<context>
    <name>Validity</name>
    <message>
        <source>no calibration in use</source>
        <translation>keine Kalibrierung in Gebrauch</translation>
    </message>
    <message>
        <source>profile cannot be read</source>
        <translation>Profil nicht lesbar</translation>
    </message>
    <message>
        <source>Calibration {number} of {made}</source>
        <translation>Kalibrierung {number} vom {made}</translation>
    </message>
    <message>
        <source>{minutes} min old</source>
        <translation>vor {minutes} min</translation>
    </message>
    <message>
        <source>{hours} h old</source>
        <translation>vor {hours} h</translation>
    </message>
    <message>
        <source>{days} days old</source>
        <translation>vor {days} Tagen</translation>
    </message>
    <message>
        <source>check: recalibrate</source>
        <translation>Prüfung: neu kalibrieren</translation>
    </message>
    <message>
        <source>check: watch it</source>
        <translation>Prüfung: beobachten</translation>
    </message>
    <message>
        <source>calibration fresh</source>
        <translation>Kalibrierung frisch</translation>
    </message>
    <message>
        <source>calibration ageing</source>
        <translation>Kalibrierung altert</translation>
    </message>
    <message>
        <source>calibration out of date</source>
        <translation>Kalibrierung veraltet</translation>
    </message>
    <message>
        <source>calibration not valid</source>
        <translation>Kalibrierung nicht gültig</translation>
    </message>
    <message>
        <source>calibration not verified</source>
        <translation>Kalibrierung nicht verifiziert</translation>
    </message>
    <message>
        <source>verification undecided</source>
        <translation>Verifizierung unentschieden</translation>
    </message>
    <message>
        <source>the check bar contradicts it</source>
        <translation>der Prüfstab widerspricht ihr</translation>
    </message>
    <message>
        <source>to be used with care</source>
        <translation>mit Vorsicht zu benutzen</translation>
    </message>
</context>
<context>
    <name>VerificationView</name>
    <message>
        <source>Errors</source>
        <translation>Abweichungen</translation>
    </message>
    <message>
        <source>In space</source>
        <translation>Im Raum</translation>
    </message>
    <message>
        <source>Length</source>
        <translation>Länge</translation>
    </message>
    <message>
        <source>n</source>
        <translation>n</translation>
    </message>
    <message>
        <source>sd, mm</source>
        <translation>s, mm</translation>
    </message>
    <message>
        <source>largest, mm</source>
        <translation>größte, mm</translation>
    </message>
    <message>
        <source>mean error, mm</source>
        <translation>mittlerer Fehler, mm</translation>
    </message>
    <message>
        <source>±, mm</source>
        <translation>±, mm</translation>
    </message>
    <message>
        <source>limit, mm</source>
        <translation>Grenze, mm</translation>
    </message>
    <message>
        <source>decision</source>
        <translation>Entscheidung</translation>
    </message>
    <message>
        <source>contribution</source>
        <translation>Beitrag</translation>
    </message>
    <message>
        <source>u, mm</source>
        <translation>u, mm</translation>
    </message>
    <message>
        <source>share</source>
        <translation>Anteil</translation>
    </message>
    <message>
        <source>what would help most</source>
        <translation>was am meisten hilft</translation>
    </message>
    <message>
        <source>Camera</source>
        <translation>Kamera</translation>
    </message>
    <message>
        <source>views of marks</source>
        <translation>Ansichten von Marken</translation>
    </message>
    <message>
        <source>used</source>
        <translation>benutzt</translation>
    </message>
    <message>
        <source>rms, px</source>
        <translation>RMS, px</translation>
    </message>
    <message>
        <source>state</source>
        <translation>Zustand</translation>
    </message>
    <message>
        <source>Lengths</source>
        <translation>Längen</translation>
    </message>
    <message>
        <source>Cameras</source>
        <translation>Kameras</translation>
    </message>
    <message>
        <source>Budget</source>
        <translation>Budget</translation>
    </message>
    <message>
        <source>(out of date)</source>
        <translation>(veraltet)</translation>
    </message>
</context>
<context>
    <name>Verify</name>
    <message>
        <source>{count} lengths, mean error {mean:+.3f} mm, largest {most:.3f} mm.</source>
        <translation>{count} Längen, mittlere Abweichung {mean:+.3f} mm, größte {most:.3f} mm.</translation>
    </message>
    <message>
        <source>Not verified, since they saw no mark: {cameras}.</source>
        <translation>Nicht verifiziert, da sie keine Marke sahen: {cameras}.</translation>
    </message>
    <message>
        <source>Not where the calibration has them: {cameras}.</source>
        <translation>Nicht an ihrem kalibrierten Ort: {cameras}.</translation>
    </message>
    <message>
        <source>Used all the same by {by}: {reason}</source>
        <translation>Trotzdem in Gebrauch durch {by}: {reason}</translation>
    </message>
    <message>
        <source>INCONSISTENT</source>
        <translation>WIDERSPRÜCHLICH</translation>
    </message>
    <message>
        <source>The uncertainty is too large for the limit: “Budget” says what helps most.</source>
        <translation>Die Unsicherheit ist zu groß für die Grenze: Unter „Budget“ steht, was am meisten hilft.</translation>
    </message>
    <message>
        <source>UNDECIDED</source>
        <translation>UNENTSCHIEDEN</translation>
    </message>
    <message>
        <source>PASS</source>
        <translation>BESTANDEN</translation>
    </message>
    <message>
        <source>FAIL</source>
        <translation>NICHT BESTANDEN</translation>
    </message>
    <message>
        <source>CONSISTENT</source>
        <translation>STIMMIG</translation>
    </message>
    <message>
        <source>No captured pose shows two marks of the bar to two cameras: capture them again.</source>
        <translation>Keine aufgenommene Lage zeigt zwei Kameras zwei Marken des Stabs: noch einmal aufnehmen.</translation>
    </message>
    <message>
        <source>NO DATA</source>
        <translation>KEINE DATEN</translation>
    </message>
    <message>
        <source>The verification is finished: {verdict}.</source>
        <translation>Die Verifizierung ist fertig: {verdict}.</translation>
    </message>
    <message>
        <source>Grey: what the uncertainty of each error allows.</source>
        <translation>Grau: was die Unsicherheit jedes Fehlers zulässt.</translation>
    </message>
    <message>
        <source>Red lines: the limit {limit}; amber: its guard band. Decided by ISO 14253-1.</source>
        <translation>Rote Linien: die Grenze {limit}; gelb: ihr Schutzbereich. Entschieden nach ISO 14253-1.</translation>
    </message>
    <message>
        <source>all together (k = {k:.1f}: U = {u:.3f} mm)</source>
        <translation>alles zusammen (k = {k:.1f}: U = {u:.3f} mm)</translation>
    </message>
</context>
<context>
    <name>VerifyPage</name>
    <message>
        <source>Locked: the responsible person sets this limit (Menu, Limits).</source>
        <translation>Gesperrt: Die verantwortliche Person stellt diese Grenze ein (Menü, Grenzwerte).</translation>
    </message>
    <message>
        <source>In space</source>
        <translation>Im Raum</translation>
    </message>
    <message>
        <source>Images</source>
        <translation>Bilder</translation>
    </message>
    <message>
        <source>Capture by itself when it lies right</source>
        <translation>Selbst aufnehmen, wenn er richtig liegt</translation>
    </message>
    <message>
        <source>Capture it as it lies</source>
        <translation>So aufnehmen, wie er liegt</translation>
    </message>
    <message>
        <source>Enough: measure now</source>
        <translation>Genug: jetzt messen</translation>
    </message>
    <message>
        <source>More poses</source>
        <translation>Mehr Lagen</translation>
    </message>
    <message>
        <source>Permitted length error (mm)</source>
        <translation>Zulässige Abweichung (mm)</translation>
    </message>
    <message>
        <source>e.g. 0.03+L/20000</source>
        <translation>z. B. 0.03+L/20000</translation>
    </message>
    <message>
        <source>Limit of the length errors: A + L/K in mm</source>
        <translation>Grenze der Längenabweichungen: A + L/K in mm</translation>
    </message>
    <message>
        <source>The largest error that is allowed, such as 0.03+L/20000; empty: judged by its own uncertainty.</source>
        <translation>Die größte erlaubte Abweichung, etwa 0.03+L/20000; leer: nach der eigenen Unsicherheit beurteilt.</translation>
    </message>
    <message>
        <source>not read</source>
        <translation>nicht abgelesen</translation>
    </message>
    <message>
        <source>Temperature of the bar</source>
        <translation>Temperatur des Stabs</translation>
    </message>
    <message>
        <source>Read it on the bar: a steel bar of 500 mm grows by 0.006 mm for each degree.</source>
        <translation>Am Stab ablesen: Ein Stahlstab von 500 mm wächst je Grad um 0,006 mm.</translation>
    </message>
    <message>
        <source>Bar</source>
        <translation>Stab</translation>
    </message>
    <message>
        <source>Captured; a click retakes it.</source>
        <translation>Aufgenommen; ein Klick nimmt sie neu auf.</translation>
    </message>
    <message>
        <source>Not captured yet.</source>
        <translation>Noch nicht aufgenommen.</translation>
    </message>
    <message>
        <source>No pose is captured yet.</source>
        <translation>Noch keine Lage aufgenommen.</translation>
    </message>
</context>
<context>
    <name>Wall</name>
    <message>
        <source>All cameras  (Esc)</source>
        <translation>Alle Kameras  (Esc)</translation>
    </message>
</context>
<context>
    <name>WindowFrame</name>
    <message>
        <source>Log</source>
        <translation>Protokoll</translation>
    </message>
    <message>
        <source>Preparing computations: {percent} %</source>
        <translation>Berechnungen werden vorbereitet: {percent} %</translation>
    </message>
    <message>
        <source>Once after the installation, while the computer has time. Everything works already.</source>
        <translation>Einmal nach der Installation, solange der Rechner Zeit hat. Alles funktioniert schon.</translation>
    </message>
</context>
<context>
    <name>WizardWindow</name>
    <message>
        <source>Work is running; wait for it or cancel it.</source>
        <translation>Es wird gearbeitet; bitte warten oder abbrechen.</translation>
    </message>
    <message>
        <source>Imported. Assumed: {what}.</source>
        <translation>Importiert. Angenommen: {what}.</translation>
    </message>
    <message>
        <source>There is no command yet: calibrate first.</source>
        <translation>Es gibt noch keinen Befehl: zuerst kalibrieren.</translation>
    </message>
    <message>
        <source>Copied.</source>
        <translation>Kopiert.</translation>
    </message>
    <message>
        <source>A sound was played. Was it heard?</source>
        <translation>Ein Ton wurde abgespielt. War er zu hören?</translation>
    </message>
    <message>
        <source>Opening</source>
        <translation>Wird geöffnet</translation>
    </message>
    <message>
        <source>not connected</source>
        <translation>nicht verbunden</translation>
    </message>
    <message>
        <source>{count} cameras</source>
        <translation>{count} Kameras</translation>
    </message>
    <message>
        <source>without {cameras}</source>
        <translation>ohne {cameras}</translation>
    </message>
    <message>
        <source>connecting</source>
        <translation>verbinde</translation>
    </message>
    <message>
        <source>The support bundle is in {path}. It contains no images.</source>
        <translation>Das Support-Paket ist in {path}. Es enthält keine Bilder.</translation>
    </message>
    <message>
        <source>The computation is still stopping; close the window again in a moment.</source>
        <translation>Die Rechnung wird noch beendet; das Fenster gleich noch einmal schließen.</translation>
    </message>
</context>
</TS>
