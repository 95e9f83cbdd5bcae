function line = first_line(text)
    % The first line of a message.
    lines = strsplit(strtrim(text), char(10));
    line = lines{1};
end
