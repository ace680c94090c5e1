; Set-up program for Windows: makensis installer/windows/spherecal.nsi, after `python dev.py installer` on Windows.
; Compiles on Linux too (apt install nsis); what it installs has to be built on Windows, and was never run by us there.
; Give it /DVERSION=0.1.0 and /DBUNDLE=path to make another than dist\spherecal.
Unicode true
!ifndef VERSION
  !define VERSION "0.1.0"
!endif
!ifndef BUNDLE
  !define BUNDLE "..\..\dist\spherecal"
!endif
!define NAME "SphereCal"
!define UNINSTALL "Software\Microsoft\Windows\CurrentVersion\Uninstall\SphereCal"

Name "${NAME} ${VERSION}"
OutFile "..\..\dist\spherecal-${VERSION}-setup.exe"
InstallDir "$LOCALAPPDATA\Programs\SphereCal"
InstallDirRegKey HKCU "Software\SphereCal" "InstallDir"
RequestExecutionLevel user ; into the user's own folder: no administrator is asked
SetCompressor /SOLID lzma

!include "LogicLib.nsh"
!include "MUI2.nsh"
!define MUI_ABORTWARNING
!insertmacro MUI_PAGE_LICENSE "..\..\LICENSE"
!insertmacro MUI_PAGE_DIRECTORY
!insertmacro MUI_PAGE_INSTFILES
!insertmacro MUI_UNPAGE_CONFIRM
!insertmacro MUI_UNPAGE_INSTFILES
!insertmacro MUI_LANGUAGE "English"
!insertmacro MUI_LANGUAGE "German"
!insertmacro MUI_LANGUAGE "SimpChinese"

Section "SphereCal"
  ; an older version goes first, so that no file of it is left behind
  ${If} ${FileExists} "$INSTDIR\spherecal.exe"
    RMDir /r "$INSTDIR\_internal"
  ${EndIf}
  SetOutPath "$INSTDIR"
  File /r "${BUNDLE}\*.*"
  WriteUninstaller "$INSTDIR\uninstall.exe"
  CreateDirectory "$SMPROGRAMS\SphereCal"
  CreateShortcut "$SMPROGRAMS\SphereCal\SphereCal.lnk" "$INSTDIR\spherecal-gui.exe"
  CreateShortcut "$SMPROGRAMS\SphereCal\Manual.lnk" "$INSTDIR\_internal\spherecal\_resources\manual\index.html"
  WriteRegStr HKCU "Software\SphereCal" "InstallDir" "$INSTDIR"
  WriteRegStr HKCU "${UNINSTALL}" "DisplayName" "SphereCal"
  WriteRegStr HKCU "${UNINSTALL}" "DisplayVersion" "${VERSION}"
  WriteRegStr HKCU "${UNINSTALL}" "DisplayIcon" "$INSTDIR\spherecal-gui.exe"
  WriteRegStr HKCU "${UNINSTALL}" "InstallLocation" "$INSTDIR"
  WriteRegStr HKCU "${UNINSTALL}" "UninstallString" '"$INSTDIR\uninstall.exe"'
  WriteRegDWORD HKCU "${UNINSTALL}" "NoModify" 1
  WriteRegDWORD HKCU "${UNINSTALL}" "NoRepair" 1
SectionEnd

Section "Uninstall"
  ; the user's projects, settings and profiles stay
  RMDir /r "$INSTDIR\_internal"
  Delete "$INSTDIR\spherecal.exe"
  Delete "$INSTDIR\spherecal-gui.exe"
  Delete "$INSTDIR\uninstall.exe"
  RMDir "$INSTDIR"
  RMDir /r "$SMPROGRAMS\SphereCal"
  DeleteRegKey HKCU "${UNINSTALL}"
  DeleteRegKey HKCU "Software\SphereCal"
SectionEnd
