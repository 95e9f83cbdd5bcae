function numbers = asked(bridge, name, question, values)
    % The numbers that a question is answered with, as a column.
    numbers = jsondecode(bridge.command(name, question, values));
    numbers = numbers(:);
end
