/* As venv's launcher on Windows: starts the Python that ../pyvenv.cfg names as home, in a job that ends with it. */
#include <stdio.h>
#include <wchar.h>
#include <windows.h>

#define LONGEST 32000

int wmain(void) {
    static wchar_t own[LONGEST], settings[LONGEST], line[LONGEST], home[LONGEST], command[LONGEST];
    GetModuleFileNameW(NULL, own, LONGEST);
    wcscpy(settings, own);
    *wcsrchr(settings, L'\\') = 0;
    wcscpy(wcsrchr(settings, L'\\'), L"\\pyvenv.cfg");
    FILE *file = _wfopen(settings, L"r, ccs=UTF-8");
    if (!file) return 106;
    while (fgetws(line, LONGEST, file))
        if (!wcsncmp(line, L"home = ", 7)) {
            wcscpy(home, line + 7);
            home[wcscspn(home, L"\r\n")] = 0;
        }
    fclose(file);
    SetEnvironmentVariableW(L"__PYVENV_LAUNCHER__", own);

    wchar_t *rest = GetCommandLineW();
    wchar_t end = *rest == L'"' ? *rest++ : L' ';
    while (*rest && *rest != end) rest++;
    if (*rest == L'"') rest++;
    swprintf(command, LONGEST, L"\"%ls\\python.exe\"%ls", home, rest);

    JOBOBJECT_EXTENDED_LIMIT_INFORMATION limits = {0};
    limits.BasicLimitInformation.LimitFlags =
        JOB_OBJECT_LIMIT_KILL_ON_JOB_CLOSE | JOB_OBJECT_LIMIT_SILENT_BREAKAWAY_OK;
    HANDLE job = CreateJobObjectW(NULL, NULL);
    SetInformationJobObject(job, JobObjectExtendedLimitInformation, &limits, sizeof limits);
    STARTUPINFOW startup;
    PROCESS_INFORMATION process;
    GetStartupInfoW(&startup);
    if (!CreateProcessW(NULL, command, NULL, NULL, TRUE, 0, NULL, NULL, &startup, &process)) return 101;
    AssignProcessToJobObject(job, process.hProcess);
    SetConsoleCtrlHandler(NULL, TRUE);
    WaitForSingleObject(process.hProcess, INFINITE);
    DWORD code;
    GetExitCodeProcess(process.hProcess, &code);
    return code;
}
