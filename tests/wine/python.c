/* python.exe: all of it is in the library. */
#include <windows.h>

int wmain(int count, wchar_t **words) {
    HMODULE library = LoadLibraryW(L"python311.dll");
    int (*start)(int, wchar_t **) = library ? (void *)GetProcAddress(library, "Py_Main") : NULL;
    return start ? start(count, words) : 120;
}
